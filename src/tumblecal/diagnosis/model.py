"""One chain that holds every testable effect: its prediction and one Jacobian serve the whole diagnosis."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import jax
import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain, Link, Parameter, Place, State, Where, coefficients
from tumblecal.chain.frames import rotate_x, rotate_y, rotate_z
from tumblecal.chain.link import turned
from tumblecal.chain.nominal import FreeAttitude
from tumblecal.diagnosis.programs import all_at_once, by_position, predicting
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
    their amplitudes are not zero. `make` makes the effect's links for other settings."""

    id: str
    variant: int
    columns: tuple[int, ...]
    shape: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    links: tuple[Link, ...]
    kinked: bool
    make: Callable[[Where], tuple[Link, ...]]


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
    `names`, `units`: of the nominal parameters. `start` is the full vector at which nothing is wrong, physical units;
    `scales` the sizes in which the Jacobian counts it. `not_testable` says for each effect that cannot be tested why.
    """

    chain: Chain
    nominal_chain: Chain
    slots: tuple[Slot, ...]
    order: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    not_testable: dict[str, str]
    start: Float[np.ndarray, " full"]
    scales: Float[np.ndarray, " full"]
    _programs: dict = field(default_factory=dict, repr=False)

    @property
    def nominal(self) -> int:
        """Number of nominal parameters."""
        return len(self.names)

    @property
    def hand_held(self) -> bool:
        """Whether the positions' attitudes are unknown: nothing of a head, and no exchange of positions, can be seen."""
        return _hand_held(self.nominal_chain)

    @property
    def probe(self) -> slice:
        """Columns of the probe."""
        return slice(len(self.order) - 3, len(self.order))

    @cached_property
    def amplitudes(self) -> list[int]:
        """Columns of the effects' amplitudes (no shape parameters)."""
        return [column for slot in self.slots for column in slot.columns]

    @cached_property
    def shapes(self) -> list[int]:
        """Columns of the effects' shape parameters (time constants)."""
        return [column for slot in self.slots for column in slot.shape]

    def started(self, where: Where) -> "Model":
        """The model for other settings of the same kind: time constants start from shares of their own duration."""
        start, scales = self.start.copy(), self.scales.copy()
        shaped = [slot for slot in self.slots if slot.shape]
        made = {slot.id: slot.make(where) for slot in shaped if slot.variant == 0}
        for slot in shaped:
            if len(made[slot.id]) > slot.variant:
                leaves = _leaves(made[slot.id][slot.variant])
                columns = sorted((*slot.columns, *slot.shape))
                start[columns] = np.concatenate([np.ravel(leaf.value) for leaf in leaves])
                scales[columns] = np.concatenate([np.full(leaf.value.size, leaf.scale) for leaf in leaves])
        return replace(self, start=start, scales=scales)

    def evaluate(self, where: Where, vector: Float[np.ndarray, " full"]) -> Evaluation:
        """Prediction and Jacobian at a full vector (physical units); compiled once for each kind of plan."""
        leaves, structure = self._flat(where)
        place = ("jacobian", structure)
        if place not in self._programs:
            self._programs[place] = self._checked(leaves, structure)
        predicted, jacobian, inputs = self._programs[place](leaves, vector, self.scales)
        return Evaluation(np.asarray(predicted), np.asarray(jacobian), np.asarray(inputs))

    def predict(self, where: Where, vector: Float[np.ndarray, " full"]) -> Float[np.ndarray, "positions 3"]:
        """Prediction alone, g: a tenth of the time of `evaluate`, and less where no effect is in the vector."""
        leaves, structure = self._flat(where)
        nominal = np.array_equal(vector[self.nominal :], self.start[self.nominal :])
        place = ("nominal prediction" if nominal else "prediction", structure)
        if place not in self._programs:
            whole = predicting(self.chain, structure, self._back)
            self._programs[place] = self._nominal_program(whole, leaves, structure) if nominal else whole
        return np.asarray(self._programs[place](leaves, vector))

    def _nominal_program(self, whole: Callable, leaves: list, structure) -> Callable:
        """The nominal chain alone, unless a link (a user's) does something even when its coefficients are zero."""
        alone = predicting(self.nominal_chain, structure, np.arange(self.nominal))
        difference = np.abs(np.asarray(alone(leaves, self.start)) - np.asarray(whole(leaves, self.start)))
        return alone if np.max(difference) < 1e-12 else whole

    def _flat(self, where: Where) -> tuple[list, Any]:
        """The settings' arrays and their structure; those of the last settings are remembered."""
        last = self._programs.get("last")
        if last is None or last[0] is not where:
            leaves, structure = jax.tree.flatten(where)
            last = self._programs["last"] = (where, leaves, structure)
        return last[1], last[2]

    def _checked(self, leaves: list, structure) -> Callable:
        """The quick program, or the slow one where a link (a user's) makes one position depend on another's values."""
        program, scales, count = by_position(self.chain, structure, self._back), self.scales, len(self.scales)
        direction, step = np.cos(np.arange(count)), 1e-5
        # Away from the start, where inputs of exactly zero would sit on the jump of a sign.
        base = self.start + 0.3 * scales * np.sin(1.0 + np.arange(count))
        predict = predicting(self.chain, structure, self._back)
        plus, minus = (np.asarray(predict(leaves, base + sign * step * scales * direction)) for sign in (1, -1))
        found = np.asarray(program(leaves, base, scales)[1]) @ direction
        error = np.max(np.abs(found - (plus - minus) / (2 * step)))
        return program if error < 1e-6 * np.max(np.abs(found)) else all_at_once(self.chain, structure, self._back)

    @cached_property
    def _back(self) -> np.ndarray:
        """Places of the chain's own vector in the full vector."""
        back = np.empty(len(self.order), np.int64)
        back[list(self.order)] = np.arange(len(self.order))
        return back


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
        if _hand_held(nominal) and all(Place.GRAVITY < link.place < Place.MOUNT for link in links):
            not_testable[effect.id] = "the attitudes are unknown"
            continue
        if any(leaf.name in taken for link in links for leaf in _leaves(link)):
            not_testable[effect.id] = "already a free parameter of the model"
            continue
        for variant, link in enumerate(links):
            chain = chain + link
            added.append((effect, variant, link))
    probe = HeadProbe(coefficients("probe", ("x", "y", "z"), unit="rad"))
    chain = chain + probe
    place, offset = {}, 0
    for leaf in chain.free:
        place[id(leaf)] = tuple(range(offset, offset + leaf.value.size))
        offset += leaf.value.size
    nominal_order = [column for leaf in nominal.free for column in place[id(leaf)]]
    order, slots = list(nominal_order), []
    for effect, variant, link in added:
        columns, shape, names, units = [], [], [], []
        for leaf in _leaves(link):
            own = list(range(len(order), len(order) + leaf.value.size))
            order += place[id(leaf)]
            (columns if not np.any(leaf.value) else shape).extend(own)
            names += leaf.names
            units += [leaf.unit] * leaf.value.size
        slots.append(
            Slot(
                effect.id,
                variant,
                tuple(columns),
                tuple(shape),
                tuple(names),
                tuple(units),
                (link,),
                effect.kinked,
                effect.make,
            )
        )
    order += place[id(probe.angles)]
    start, scales = chain.vector[order], chain.scales[order]
    return Model(chain, nominal, tuple(slots), tuple(order), nominal.names, nominal.units, not_testable, start, scales)


def _hand_held(chain: Chain) -> bool:
    return any(isinstance(link, FreeAttitude) and link.tilt.by == "position" for link in chain.links)


def _leaves(link: Link) -> list[Parameter]:
    leaves = jax.tree.leaves(link, is_leaf=lambda node: isinstance(node, Parameter))
    return [leaf for leaf in leaves if isinstance(leaf, Parameter) and leaf.free]
