"""A chain as compiled programs of arrays alone: its readings, and its Jacobian for all positions at once."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.chain import Chain, Where
from tumblecal.estimation.programs import cached_program
from tumblecal.ground.showing import brief


class Evaluation(NamedTuple):
    """Predictions (positions, 3) in g, their derivative by the scaled full vector, and the ideal inputs u in g."""

    predicted: Float[np.ndarray, "positions 3"]
    jacobian: Float[np.ndarray, "positions 3 full"]
    inputs: Float[np.ndarray, "positions 3"]


@dataclass(frozen=True, eq=False)
class Programs:
    """The compiled programs of one chain for plans of one kind; each takes (settings, vector) or (settings, vector, scales).

    - `chain`, `back`: the whole chain, and the index of each entry of its vector in the full vector. `nominal`: the chain of
      the first entries of the full vector.
    - `by_position`: whether the readings of a position depend on its own settings alone; the fast Jacobian is exact then.
    - `quiet`: whether the other links have no effect with zero coefficients; `predict_nominal` then omits them.
    """

    __repr__ = brief

    chain: Chain
    back: np.ndarray
    nominal: Chain
    by_position: bool = True
    quiet: bool = True

    @cached_property
    def predict(self) -> Callable[..., Any]:
        """Readings (positions, 3), g."""
        return _forward(self.chain, self.back, 0)

    @cached_property
    def predict_nominal(self) -> Callable[..., Any]:
        """The same where no effect is in the vector."""
        return _forward(self.nominal, np.arange(len(self.nominal.names)), 0) if self.quiet else self.predict

    @cached_property
    def evaluate(self) -> Callable[..., Any]:
        """Readings, Jacobian and inputs."""
        return (_by_position if self.by_position else _all_at_once)(self.chain, self.back)

    @cached_property
    def inputs(self) -> Callable[..., Any]:
        """Ideal inputs (positions, 3), g."""
        return _forward(self.chain, self.back, 1)

    def __getstate__(self) -> dict[str, Any]:
        # Programs are compiled again in another process.
        return {part.name: getattr(self, part.name) for part in fields(self)}


def programs_of(
    chain: Chain,
    back: np.ndarray,
    nominal: Chain,
    where: Where,
    start_vector: Float[np.ndarray, " full"],
    scales: Float[np.ndarray, " full"],
    like: Programs | None = None,
) -> Programs:
    """Programs that were checked on the settings of one plan.

    The nominal chain alone is used if no other effect acts, unless a link (of a user) has an effect with zero coefficients. The
    fast Jacobian is used unless a link makes one position depend on the values of another.

    **Arguments:**

    - `chain`, `back`: the whole chain, and the index of each entry of its vector in the full vector.
    - `nominal`: the chain of the first entries of the full vector.
    - `where`, `start_vector`, `scales`: settings, full vector without any error, typical sizes of its entries.
    - `like`: checked programs of a different plan. If they have every kind of link of this chain, the checks, which need two
      more programs, are not repeated.
    """
    if like is not None and {*map(type, chain.links)} <= {*map(type, like.chain.links)}:
        return Programs(chain, back, nominal, like.by_position, like.quiet)
    programs = Programs(chain, back, nominal)
    alone, whole = (np.asarray(run(where, start_vector)) for run in (programs.predict_nominal, programs.predict))
    direction, step = np.cos(np.arange(len(scales))), 1e-5
    # Not at the start, where inputs of exactly zero lie on the jump of a sign.
    base = start_vector + 0.3 * scales * np.sin(1.0 + np.arange(len(scales)))
    plus, minus = (np.asarray(programs.predict(where, base + sign * step * scales * direction)) for sign in (1, -1))
    slope = np.asarray(programs.evaluate(where, base, scales)[1]) @ direction
    error = np.max(np.abs(slope - (plus - minus) / (2 * step)))
    by_position, quiet = bool(error < 1e-6 * np.max(np.abs(slope))), bool(np.max(np.abs(alone - whole)) < 1e-12)
    # The programs used for the check, which are compiled, if they are exact.
    return programs if by_position and quiet else Programs(chain, back, nominal, by_position, quiet)


def _run(chain: Chain, where: Where) -> tuple[Array, Array]:
    """Readings and ideal inputs (positions, 3)."""
    state = chain.state(where)
    return jnp.stack(state.reading, axis=-1), jnp.stack(state.f, axis=-1)


def _forward(chain: Chain, back: np.ndarray, part: int) -> Callable[..., Any]:
    """The readings, or the inputs, at a full vector, in which `back` are the indices of the chain's entries."""
    return cached_program(lambda where, vector: _run(chain.at(vector[back]), where)[part], chain, back, part)


def _by_position(chain: Chain, back: np.ndarray) -> Callable[..., Any]:
    """Readings, Jacobian (positions, 3, full) and inputs by three backward passes: each position has a copy of the
    parameters, so that one pass gives one row for each position."""

    @jax.jit  # traced once for both programs
    def forward(where, vector):
        placed = chain.at(jnp.broadcast_to(vector[back][:, None], (vector.shape[0], where.alpha.shape[0])))

        # Differentiate by the values of each leaf, not by the vector: this avoids sums of arrays as long as the vector.
        def run(values):
            return _run(eqx.tree_at(lambda tree: [leaf.value for leaf in tree.free], placed, values), where)

        return jax.vjp(run, [leaf.value for leaf in placed.free], has_aux=True)

    def arrays(where, vector):
        reading, backward, inputs = forward(where, vector)
        # One array: passing hundreds of arrays takes longer than the computation.
        return reading, jnp.concatenate([leaf.ravel().astype(float) for leaf in jax.tree.leaves(backward)]), inputs

    def rows(saved, where, vector, scales):
        leaves, structure = jax.tree.flatten(jax.eval_shape(forward, where, vector)[1])
        parts = jnp.split(saved, np.cumsum([leaf.size for leaf in leaves])[:-1])
        restored = [part.reshape(leaf.shape).astype(leaf.dtype) for part, leaf in zip(parts, leaves, strict=True)]
        count = where.alpha.shape[0]
        each = jnp.broadcast_to(jnp.eye(3)[:, None], (3, count, 3))
        (by_leaf,) = jax.vmap(jax.tree.unflatten(structure, restored))(each)
        by_entry = jnp.concatenate([rows.reshape(3, -1, count) for rows in by_leaf], axis=1)
        return jnp.moveaxis(by_entry[:, np.argsort(back)], 2, 0) * scales[None, None, :]

    # Two programs: in a single one, XLA's fusions recompute common values for every entry.
    first, second = cached_program(arrays, chain, back), cached_program(rows, chain, back)

    def evaluate(where, vector, scales):
        reading, saved, inputs = first(where, vector)
        return reading, second(saved, where, vector, scales), inputs

    return evaluate


def _all_at_once(chain: Chain, back: np.ndarray) -> Callable[..., Any]:
    """The same by forward differentiation, for links that mix positions."""

    def program(where, vector, scales):
        def run(scaled):
            reading, inputs = _run(chain.at((scaled * scales)[back]), where)
            return reading, (reading, inputs)

        jacobian, (reading, inputs) = jax.jacfwd(run, has_aux=True)(vector / scales)
        return reading, jacobian, inputs

    return cached_program(program, chain, back)
