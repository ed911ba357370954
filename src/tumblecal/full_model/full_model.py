"""One chain with every testable effect: its prediction and one Jacobian serve the whole diagnosis."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain, Link, Parameter, Place, State, Where, coefficients, parameters_of
from tumblecal.chain.link import turned
from tumblecal.effects import Catalogue, Effect
from tumblecal.estimation.chain_programs import Evaluation, Programs, programs_of
from tumblecal.full_model.followed import already_followed
from tumblecal.full_model.layout import Layout, Slot, hand_held
from tumblecal.ground.frames import rotate_x, rotate_y, rotate_z
from tumblecal.ground.showing import brief
from tumblecal.ground.temperature_functions import HIGHEST_ORDER


# Plans whose evaluation at the start is remembered.
_MOST_PLANS = 64


class HeadProbe(Link):
    """A small rotation of the head's frame before the spindle, shared by all positions.

    Its Jacobian columns are the response of every position to a rotation about x, y and z: the signal of an unknown error of
    the head at that position.
    """

    place: ClassVar[Place] = Place.WOBBLE
    angles: Parameter

    def __call__(self, state: State, where: Where) -> State:
        """The state seen from the turned frame."""
        x, y, z = self.angles.at(where)
        return turned(state, rotate_x(x, rotate_y(y, rotate_z(z, state.f))))


@dataclass(frozen=True)
class FullModel:
    """The nominal chain with all testable effects in it, their coefficients zero.

    The full vector has the nominal parameters first (`nominal` of them), then those of the effects, then the three of the
    probe. `names`, `units`: of the nominal parameters. `start` is the full vector without errors, physical units; `scales` are
    the units of the Jacobian's columns. `not_testable` gives the reason for each effect that cannot be tested.
    """

    __repr__ = brief

    layout: Layout
    not_testable: dict[str, str]
    start: Float[np.ndarray, " full"]
    scales: Float[np.ndarray, " full"]
    programs: Programs
    _at_start: dict[tuple, Evaluation] = field(default_factory=dict)

    @property
    def nominal_chain(self) -> Chain:
        """The model in use."""
        return self.layout.nominal_chain

    @property
    def slots(self) -> tuple[Slot, ...]:
        """The effects' links and their columns."""
        return self.layout.slots

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the nominal parameters."""
        return self.layout.names

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the nominal parameters."""
        return self.layout.units

    @property
    def nominal(self) -> int:
        """Number of nominal parameters."""
        return self.layout.nominal

    @property
    def hand_held(self) -> bool:
        """Whether the positions' attitudes are unknown."""
        return self.layout.hand_held

    @property
    def of_plan(self) -> bool:
        """Whether the angles and groups alone decide the readings where there is no effect; some user's effect may act without
        a coefficient too."""
        return self.layout.of_plan and self.programs.quiet

    @property
    def probe(self) -> slice:
        """Columns of the probe."""
        return slice(len(self.start) - 3, len(self.start))

    def started(self, where: Where) -> "FullModel":
        """The model for different settings of the same kind: time constants start from shares of their duration."""
        start, scales = self.start.copy(), self.scales.copy()
        shaped = [slot for slot in self.slots if slot.shape]
        made = {slot.id: slot.make(where) for slot in shaped if slot.variant == 0}
        for slot in shaped:
            if len(made[slot.id]) > slot.variant:
                leaves = _leaves(made[slot.id][slot.variant])
                start[slot.all_columns] = np.concatenate([np.ravel(leaf.value) for leaf in leaves])
                scales[slot.all_columns] = np.concatenate([np.full(leaf.value.size, leaf.scale) for leaf in leaves])
        return replace(self, start=start, scales=scales)

    def with_time_constants(self, times: Mapping[str, Float[np.ndarray, " shape"]]) -> "FullModel":
        """The model whose effects of these ids start from these time constants (base units), every variant from the same."""
        start = self.start.copy()
        for slot in self.slots:
            if slot.id in times:
                start[list(slot.shape)] = times[slot.id]
        return replace(self, start=start)

    def evaluate(self, where: Where, vector: Float[np.ndarray, " full"]) -> Evaluation:
        """Prediction and Jacobian at a full vector (physical units); compiled once for each kind of plan."""
        return Evaluation(*map(np.asarray, self.programs.evaluate(where, vector, self.scales)))

    def at_start(self, where: Where) -> Evaluation:
        """Prediction, Jacobian by the nominal parameters only, and inputs, without errors.

        Computed once for a plan, if its angles and groups determine it.
        """
        columns = (where.alpha, where.beta, *where.groups.values())
        plan = tuple(np.asarray(column).tobytes() for column in columns)
        if plan not in self._at_start or not self.of_plan:
            predicted, jacobian, inputs = self.evaluate(where, self.start)
            while len(self._at_start) >= _MOST_PLANS:
                self._at_start.pop(next(iter(self._at_start)))
            self._at_start[plan] = Evaluation(predicted, np.ascontiguousarray(jacobian[:, :, : self.nominal]), inputs)
        return self._at_start[plan]

    def predict(self, where: Where, vector: Float[np.ndarray, " full"]) -> Float[np.ndarray, "positions 3"]:
        """Prediction alone, g: a tenth of the time of `evaluate`, and less where no effect is in the vector."""
        nothing = np.array_equal(vector[self.nominal :], self.start[self.nominal :])
        return np.asarray((self.programs.predict_nominal if nothing else self.programs.predict)(where, vector))

    def inputs(self, where: Where, vector: Float[np.ndarray, " full"]) -> Float[np.ndarray, "positions 3"]:
        """The ideal inputs alone, g."""
        return np.asarray(self.programs.inputs(where, vector))

    def with_nominal(self, values: Float[np.ndarray, " nominal"]) -> Float[np.ndarray, " full"]:
        """The full vector with these nominal parameters and no effect."""
        return np.concatenate([values, self.start[self.nominal :]])


def settings_key(where: Where) -> tuple[Any, ...]:
    """Key of a model: number of positions, columns, groups, soaks; not the values of the columns."""
    present = tuple(getattr(where, name) is None for name in ("time_s", "temperature_degc", "approach"))
    return (len(np.asarray(where.alpha)), present, where.labels, min(where.soaks, HIGHEST_ORDER + 1))


def model_of(nominal: Chain, where: Where, entries: Catalogue, like: FullModel | None = None) -> FullModel:
    """The nominal chain with every effect that these settings allow.

    **Arguments:**

    - `nominal`: the model in use.
    - `where`: settings of the positions.
    - `entries`: the catalogue.
    - `like`: a model of a different plan with the same kinds of links; the checks of its programs are not repeated.

    **Returns:** the model; effects that need more than the settings have are listed in `not_testable` with the reason.
    """
    chain, added, not_testable = nominal, [], {}
    for effect in entries.values():
        if effect.make is None:
            continue
        reason = _reason_against(effect, nominal, where)
        if reason:
            not_testable[effect.id] = reason
            continue
        for variant, link in enumerate(effect.make(where)):
            chain = chain + link
            added.append((effect, variant, link))
    probe = HeadProbe(coefficients("probe", ("x", "y", "z"), unit="rad"))
    chain = chain + probe
    at, offset = {}, 0
    for leaf in chain.free:
        at[id(leaf)] = tuple(range(offset, offset + leaf.value.size))
        offset += leaf.value.size
    order, slots = [column for leaf in nominal.free for column in at[id(leaf)]], []
    for effect, variant, link in added:
        slots.append(_slot(effect, variant, link, len(order)))
        order += [column for leaf in _leaves(link) for column in at[id(leaf)]]
    order += at[id(probe.angles)]
    start, scales = chain.vector[order], chain.scales[order]
    back = np.empty(len(order), np.int64)
    back[order] = np.arange(len(order))
    checked = None if like is None else like.programs
    programs = programs_of(chain, back, nominal, where, start, scales, checked)
    return FullModel(Layout(chain, nominal, tuple(slots)), not_testable, start, scales, programs)


def _reason_against(effect: Effect, nominal: Chain, where: Where) -> str:
    """Why an effect cannot be tested, "" where it can."""
    if effect.found_as:
        return f"it would be found as {effect.found_as}"
    lacking = effect.lacking(where)
    if lacking:
        return f"the data have {lacking}"
    assert effect.make is not None
    links = effect.make(where)
    of_head = all(Place.GRAVITY < link.place <= Place.MOUNT or getattr(link, "by", "") == "pitch" for link in links)
    if hand_held(nominal) and (effect.looks_back or of_head):
        return "the attitudes are unknown"
    if followed := already_followed(effect, nominal, where):
        return f"{followed} of the model already follows temperature"
    taken = {leaf.name for leaf in nominal.free}
    return "already a free parameter of the model" if any(leaf.name in taken for leaf in _leaves(links)) else ""


def _slot(effect: Effect, variant: int, link: Link, first: int) -> Slot:
    """The columns of a link whose leaves begin at `first` in the full vector."""
    columns, shape, names, units = [], [], [], []
    for leaf in _leaves(link):
        own = range(first + len(names), first + len(names) + leaf.value.size)
        (columns if not np.any(leaf.value) else shape).extend(own)
        names += leaf.names
        units += [leaf.unit] * leaf.value.size
    assert effect.make is not None
    return Slot(
        effect.id,
        variant,
        tuple(columns),
        tuple(shape),
        tuple(names),
        tuple(units),
        (link,),
        effect.kinked,
        effect.make,
        "temperature_degc" in effect.needs,
        effect.weight,
        effect.shares[variant] if effect.shares else 1.0,
        effect.largest,
        effect.needs,
        *effect.polynomial,
        effect.over_temperature,
    )


def _leaves(links) -> list[Parameter]:
    return [leaf for leaf in parameters_of(links) if leaf.free]
