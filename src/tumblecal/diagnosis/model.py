"""One chain that holds every testable effect: its prediction and one Jacobian serve the whole diagnosis."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain, Link, Parameter, Place, State, Where, coefficients
from tumblecal.chain.frames import rotate_x, rotate_y, rotate_z
from tumblecal.chain.link import start, turned
from tumblecal.effects import Catalogue


class HeadProbe(Link):
    """A small rotation of the head's frame before the spindle, shared by all positions.

    Its Jacobian columns are every position's response to a rotation about x, y and z: what an unknown error of the
    head looks like at that position.
    """

    place: ClassVar[Place] = Place.WOBBLE
    angles: Parameter

    def __call__(self, state: State, where: Where) -> State:
        """The state seen from the turned frame."""
        x, y, z = self.angles.at(where)
        return turned(state, rotate_x(x, rotate_y(y, rotate_z(z, state.f))))


@dataclass(frozen=True)
class Slot:
    """The columns of one link of one effect in the full vector; `shape` columns (a time constant) act only once
    their amplitudes are not zero."""

    id: str
    variant: int
    columns: tuple[int, ...]
    shape: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    links: tuple[Link, ...]
    kinked: bool


@dataclass(frozen=True)
class Evaluation:
    """Predictions (positions, 3) in g, their derivative by the scaled full vector, and the ideal inputs u in g."""

    predicted: Float[np.ndarray, "positions 3"]
    jacobian: Float[np.ndarray, "positions 3 full"]
    inputs: Float[np.ndarray, "positions 3"]


@dataclass(frozen=True)
class Model:
    """The nominal chain with all testable effects in it, their coefficients zero.

    The full vector holds the nominal parameters first (`nominal` of them), then the effects', then the probe's three.
    `not_testable` says for each effect that cannot be tested why.
    """

    chain: Chain
    nominal_chain: Chain
    slots: tuple[Slot, ...]
    order: tuple[int, ...]
    not_testable: dict[str, str]

    @cached_property
    def nominal(self) -> int:
        """Number of nominal parameters."""
        return len(self.nominal_chain.names)

    @property
    def probe(self) -> slice:
        """Columns of the probe."""
        return slice(len(self.order) - 3, len(self.order))

    @cached_property
    def amplitudes(self) -> list[int]:
        """Columns of the effects' amplitudes (no shape parameters)."""
        return [column for slot in self.slots for column in slot.columns]

    @cached_property
    def start(self) -> Float[np.ndarray, " full"]:
        """The full vector at which nothing is wrong, physical units."""
        return self.chain.vector[list(self.order)]

    @cached_property
    def scales(self) -> Float[np.ndarray, " full"]:
        """Sizes in which the full vector is counted by the Jacobian."""
        return self.chain.scales[list(self.order)]

    def evaluate(self, where: Where, vector: Float[np.ndarray, " full"]) -> Evaluation:
        """Prediction and Jacobian at a full vector (physical units); compiled once for each kind of plan."""
        leaves, structure = jax.tree.flatten(where)
        if structure not in self._programs:
            self._programs[structure] = _compiled(self.chain, structure)
        predicted, jacobian, inputs = self._programs[structure](leaves, vector[self._back], self.scales[self._back])
        return Evaluation(np.asarray(predicted), np.asarray(jacobian)[:, :, list(self.order)], np.asarray(inputs))

    @cached_property
    def _programs(self) -> dict:
        return {}

    @cached_property
    def _back(self) -> np.ndarray:
        """Places of the chain's own vector in the full vector."""
        back = np.empty(len(self.order), np.int64)
        back[list(self.order)] = np.arange(len(self.order))
        return back


# XLA's fusion emitters for the CPU compute a chain of 60 links over and over: 2.4 s instead of 2.4 ms (jax 0.10.2).
_OPTIONS = {"xla_cpu_use_fusion_emitters": False}


@functools.cache
def _options() -> dict:
    """XLA's option against over-fusion, where this version of XLA has it."""
    try:
        jax.jit(lambda x: x + 1.0, compiler_options=_OPTIONS)(1.0)
    except RuntimeError:
        return {}
    return _OPTIONS


def _compiled(chain: Chain, structure) -> Callable:
    """The evaluation of a chain for settings of one structure, as a function of arrays alone (cheap to call)."""

    def program(leaves, vector, scales):
        where = jax.tree.unflatten(structure, leaves)

        def run(scaled):
            state = start(where)
            for link in chain.at(scaled * scales).links:
                state = link(state, where)
            reading = jnp.stack(state.reading, axis=-1)
            return reading, (reading, jnp.stack(state.f, axis=-1))

        jacobian, (reading, inputs) = jax.jacfwd(run, has_aux=True)(vector / scales)
        return reading, jacobian, inputs

    return jax.jit(program, compiler_options=_options())


def model_of(nominal: Chain, where: Where, entries: Catalogue) -> Model:
    """The nominal chain with every effect that these settings allow.

    **Arguments:**

    - `nominal`: the model in use.
    - `where`: settings of the positions.
    - `entries`: the catalogue.

    **Returns:** the model; effects that lack a column are listed in `not_testable` with the reason.
    """
    chain, added, not_testable = nominal, [], {}
    taken = {leaf.name for leaf in nominal.free}
    for effect in entries.values():
        if effect.make is None:
            continue
        missing = effect.missing(where)
        if missing:
            not_testable[effect.id] = f"the data have no column {' and '.join(missing)}"
            continue
        links = effect.make(where)
        if any(leaf.name in taken for link in links for leaf in _leaves(link)):
            not_testable[effect.id] = "already a free parameter of the model"
            continue
        for variant, link in enumerate(links):
            chain = chain + link
            added.append((effect.id, variant, link, effect.kinked))
    probe = HeadProbe(coefficients("probe", ("x", "y", "z"), unit="rad"))
    chain = chain + probe
    place, offset = {}, 0
    for leaf in chain.free:
        place[id(leaf)] = tuple(range(offset, offset + leaf.value.size))
        offset += leaf.value.size
    nominal_order = [column for leaf in nominal.free for column in place[id(leaf)]]
    order, slots = list(nominal_order), []
    for name, variant, link, kinked in added:
        columns, shape, names, units = [], [], [], []
        for leaf in _leaves(link):
            own = list(range(len(order), len(order) + leaf.value.size))
            order += place[id(leaf)]
            (columns if not np.any(leaf.value) else shape).extend(own)
            names += leaf.names
            units += [leaf.unit] * leaf.value.size
        slots.append(Slot(name, variant, tuple(columns), tuple(shape), tuple(names), tuple(units), (link,), kinked))
    order += place[id(probe.angles)]
    return Model(chain, nominal, tuple(slots), tuple(order), not_testable)


def _leaves(link: Link) -> list[Parameter]:
    leaves = jax.tree.leaves(link, is_leaf=lambda node: isinstance(node, Parameter))
    return [leaf for leaf in leaves if isinstance(leaf, Parameter) and leaf.free]
