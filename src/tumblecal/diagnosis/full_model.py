"""One chain that holds every testable effect: its prediction and one Jacobian serve the whole diagnosis."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import jax
import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain, Link, Parameter, Place, State, Where, coefficients, parameters_of
from tumblecal.chain.link import turned
from tumblecal.chain.nominal import FreeAttitude
from tumblecal.effects import Catalogue, Effect
from tumblecal.estimation.chain_programs import Evaluation, Programs, programs_of
from tumblecal.ground.frames import rotate_x, rotate_y, rotate_z
from tumblecal.ground.showing import brief


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
    their amplitudes are not zero. `make` makes the effect's links for other settings; `thermal`: they read the
    temperature; `weight`: how often the effect is the cause; `share`: of that, the variant's beside the others'."""

    __repr__ = brief

    id: str
    variant: int
    columns: tuple[int, ...]
    shape: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    links: tuple[Link, ...]
    kinked: bool
    make: Callable[[Where], tuple[Link, ...]]
    thermal: bool = False
    weight: float = 1.0
    share: float = 1.0

    @property
    def all_columns(self) -> list[int]:
        """Amplitudes and shapes as they stand, in the order of `names`."""
        return sorted((*self.columns, *self.shape))


@dataclass(frozen=True)
class FullModel:
    """The nominal chain with all testable effects in it, their coefficients zero.

    The full vector holds the nominal parameters first (`nominal` of them), then the effects', then the probe's three.
    `names`, `units`: of the nominal parameters. `start` is the full vector at which nothing is wrong, physical units;
    `scales` the sizes in which the Jacobian counts it. `not_testable` says for each effect that cannot be tested why.
    """

    __repr__ = brief

    chain: Chain
    nominal_chain: Chain
    slots: tuple[Slot, ...]
    not_testable: dict[str, str]
    start: Float[np.ndarray, " full"]
    scales: Float[np.ndarray, " full"]
    programs: Programs

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the nominal parameters."""
        return self.nominal_chain.names

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the nominal parameters."""
        return self.nominal_chain.units

    @cached_property
    def nominal(self) -> int:
        """Number of nominal parameters."""
        return len(self.names)

    @cached_property
    def hand_held(self) -> bool:
        """Whether the positions' attitudes are unknown: nothing of a head, and no exchange of positions, can be seen."""
        return _hand_held(self.nominal_chain)

    @cached_property
    def key(self) -> tuple:
        """What tells one model from another."""
        return key_of(self.chain)

    @property
    def probe(self) -> slice:
        """Columns of the probe."""
        return slice(len(self.start) - 3, len(self.start))

    @cached_property
    def amplitudes(self) -> list[int]:
        """Columns of the effects' amplitudes (no shape parameters)."""
        return [column for slot in self.slots for column in slot.columns]

    @cached_property
    def shapes(self) -> list[int]:
        """Columns of the effects' shape parameters (time constants)."""
        return [column for slot in self.slots for column in slot.shape]

    @cached_property
    def jumping(self) -> list[int]:
        """Columns of the amplitudes of effects that jump with an input's sign."""
        return [column for slot in self.slots if slot.kinked for column in slot.columns]

    def started(self, where: Where) -> "FullModel":
        """The model for other settings of the same kind: time constants start from shares of their own duration."""
        start, scales = self.start.copy(), self.scales.copy()
        shaped = [slot for slot in self.slots if slot.shape]
        made = {slot.id: slot.make(where) for slot in shaped if slot.variant == 0}
        for slot in shaped:
            if len(made[slot.id]) > slot.variant:
                leaves = _leaves(made[slot.id][slot.variant])
                start[slot.all_columns] = np.concatenate([np.ravel(leaf.value) for leaf in leaves])
                scales[slot.all_columns] = np.concatenate([np.full(leaf.value.size, leaf.scale) for leaf in leaves])
        return replace(self, start=start, scales=scales)

    def evaluate(self, where: Where, vector: Float[np.ndarray, " full"]) -> Evaluation:
        """Prediction and Jacobian at a full vector (physical units); compiled once for each kind of plan."""
        return Evaluation(*map(np.asarray, self.programs.evaluate(where, vector, self.scales)))

    def predict(self, where: Where, vector: Float[np.ndarray, " full"]) -> Float[np.ndarray, "positions 3"]:
        """Prediction alone, g: a tenth of the time of `evaluate`, and less where no effect is in the vector."""
        nothing = np.array_equal(vector[self.nominal :], self.start[self.nominal :])
        return np.asarray((self.programs.predict_nominal if nothing else self.programs.predict)(where, vector))

    def with_nominal(self, values: Float[np.ndarray, " nominal"]) -> Float[np.ndarray, " full"]:
        """The full vector with these nominal parameters and no effect."""
        return np.concatenate([values, self.start[self.nominal :]])


def key_of(chain: Chain) -> tuple:
    """What tells one chain from another: links, names, values."""
    leaves, structure = jax.tree.flatten(chain)
    return structure, tuple(np.asarray(leaf).tobytes() for leaf in leaves)


def settings_key(where: Where) -> tuple:
    """What a model depends on: how many positions, which columns, which groups; not the columns' values."""
    present = tuple(getattr(where, name) is None for name in ("time_s", "temperature_degc", "approach"))
    return (len(np.asarray(where.alpha)), present, where.labels)


def model_of(nominal: Chain, where: Where, entries: Catalogue) -> FullModel:
    """The nominal chain with every effect that these settings allow.

    **Arguments:**

    - `nominal`: the model in use.
    - `where`: settings of the positions.
    - `entries`: the catalogue.

    **Returns:** the model; effects that lack a column are listed in `not_testable` with the reason.
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
    programs = programs_of(chain, back, nominal, where, start, scales)
    return FullModel(chain, nominal, tuple(slots), not_testable, start, scales, programs)


def _reason_against(effect: Effect, nominal: Chain, where: Where) -> str:
    """Why an effect cannot be tested, "" where it can."""
    if effect.found_as:
        return f"it would be found as {effect.found_as}"
    missing = effect.missing(where)
    if missing:
        return f"the data have no column {' and '.join(missing)}"
    assert effect.make is not None
    links = effect.make(where)
    if effect.commanded and any(getattr(link, "nominal", None) is not None for link in nominal.links):
        return "the triad is turned in its fixture"
    of_head = all(Place.GRAVITY < link.place < Place.MOUNT or getattr(link, "by", "") == "pitch" for link in links)
    if _hand_held(nominal) and (effect.commanded or of_head):
        return "the attitudes are unknown"
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
    )


def _hand_held(chain: Chain) -> bool:
    return any(isinstance(link, FreeAttitude) and link.tilt.by == "position" for link in chain.links)


def _leaves(links) -> list[Parameter]:
    return [leaf for leaf in parameters_of(links) if leaf.free]
