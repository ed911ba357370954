"""A chain as compiled programs of arrays alone: its readings, and its Jacobian for all positions at once."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from tumblecal.chain import Chain, Where
from tumblecal.chain.frames import Vector
from tumblecal.chain.link import start


# XLA's fusion emitters for the CPU compute a chain of 60 links over and over: 30 ms instead of 1 ms (jax 0.10.2).
_OPTIONS = {"xla_cpu_use_fusion_emitters": False}


@functools.cache
def _options() -> dict:
    """XLA's option against over-fusion, where this version of XLA has it."""
    try:
        jax.jit(lambda x: x + 1.0, compiler_options=_OPTIONS)(1.0)
    except RuntimeError:
        return {}
    return _OPTIONS


def _run(chain: Chain, where: Where, vector: jax.Array) -> tuple[Vector, jax.Array]:
    """Readings by axis, and the ideal inputs (positions, 3)."""
    state = start(where)
    for link in chain.at(vector).links:
        state = link(state, where)
    return state.reading, jnp.stack(state.f, axis=-1)


def predicting(chain: Chain, structure, back: np.ndarray) -> Callable:
    """The readings for settings of one structure, as a function of arrays alone (cheap to call): the settings' leaves and
    the full vector, in which `back` are the places of the chain's own."""

    def program(leaves, vector):
        return jnp.stack(_run(chain, jax.tree.unflatten(structure, leaves), vector[back])[0], axis=-1)

    return jax.jit(program, compiler_options=_options())


def by_position(chain: Chain, structure, back: np.ndarray) -> Callable:
    """Readings, Jacobian (positions, 3, full) and inputs by three backward passes: every position has its own copy of
    the parameters, so that one pass gives a whole row for each position."""

    def program(leaves, vector, scales):
        where = jax.tree.unflatten(structure, leaves)
        count = where.alpha.shape[0]
        copies = jnp.broadcast_to(vector[back][:, None], (vector.shape[0], count))
        reading, backward, inputs = jax.vjp(lambda own: _run(chain, where, own), copies, has_aux=True)
        each = jnp.broadcast_to(jnp.eye(3)[:, :, None], (3, 3, count))
        (rows,) = jax.vmap(backward)(tuple(each[:, axis] for axis in range(3)))
        jacobian = jnp.moveaxis(rows[:, np.argsort(back)], 2, 0) * scales[None, None, :]
        return jnp.stack(reading, axis=-1), jacobian, inputs

    return jax.jit(program, compiler_options=_options())


def all_at_once(chain: Chain, structure, back: np.ndarray) -> Callable:
    """The same by forward differentiation, for links that mix positions."""

    def program(leaves, vector, scales):
        where = jax.tree.unflatten(structure, leaves)

        def run(scaled):
            reading, inputs = _run(chain, where, (scaled * scales)[back])
            return jnp.stack(reading, axis=-1), (jnp.stack(reading, axis=-1), inputs)

        jacobian, (reading, inputs) = jax.jacfwd(run, has_aux=True)(vector / scales)
        return reading, jacobian, inputs

    return jax.jit(program, compiler_options=_options())
