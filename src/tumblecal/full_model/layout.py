"""Entries of a full vector: nominal parameters, then those of the effects' links, then the three angles of the probe."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.chain import Chain, Link, Where, followings_of, parameters_of
from tumblecal.chain.nominal import LINKS, FreeAttitude
from tumblecal.ground.showing import brief


@dataclass(frozen=True)
class Slot:
    """The columns of one link of one effect in the full vector; `shape` columns (a time constant) act only once their
    amplitudes are not zero. `make` makes the effect's links for other settings; `thermal`: they read the temperature;
    `weight`: how often the effect is the cause; `share`: the share of this variant in it; `largest`: size of a coefficient
    (base unit) beyond which it is no cause; `needs`: required columns; `polynomial`, `order`: as of `Effect.polynomial`,
    and `over_temperature`."""

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
    largest: float = math.inf
    needs: tuple[str, ...] = ()
    polynomial: tuple[str, ...] = ()
    order: int = 0
    over_temperature: tuple[Any, ...] = ()

    @property
    def parameter_over_temperature(self) -> tuple[Any, ...]:
        """Axis and powers of the inputs of the parameter that follows one power or several of the temperature; () for any other
        effect."""
        return self.over_temperature or ((self.polynomial[0], 0, 0, 0) if self.polynomial[1:] == ("degc",) else ())

    @property
    def of_several_orders(self) -> bool:
        """Whether it is a polynomial of the temperature that includes the entries of lower orders."""
        return bool(self.over_temperature) and len(self.columns) > 1

    @property
    def all_columns(self) -> list[int]:
        """Present amplitudes and shapes, in the order of `names`."""
        return sorted((*self.columns, *self.shape))


@dataclass(frozen=True, eq=False)
class Layout:
    """The full vector of one kind of plan; the same for all data of that kind.

    `chain`: with all testable effects, of which `slots` says the columns; `nominal_chain`: that of the first entries.
    """

    __repr__ = brief

    chain: Chain
    nominal_chain: Chain
    slots: tuple[Slot, ...]

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
    def of_positions(self) -> Bool[np.ndarray, " nominal"]:
        """Which nominal parameters belong to one position each."""
        single = self.nominal_chain.of_positions
        return np.array([name in single for name in self.names])

    @cached_property
    def hand_held(self) -> bool:
        """Whether the positions' attitudes are unknown: nothing of a head, and no exchange of positions, can be seen."""
        return hand_held(self.nominal_chain)

    @cached_property
    def of_plan(self) -> bool:
        """Whether angles and groups alone determine the nominal readings: the chain of a rig may contain effects, or leaves
        that follow temperature."""
        kinds = {named.kind for named in LINKS.values()}
        return all(type(link) in kinds for link in self.nominal_chain.links) and not followings_of(self.nominal_chain)

    @cached_property
    def key(self) -> tuple[Any, ...]:
        """Key of a model."""
        return key_of(self.chain)

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

    @cached_property
    def thermal(self) -> list[int]:
        """Columns of the amplitudes of effects that read the temperature."""
        return [column for slot in self.slots if slot.thermal for column in slot.columns]

    @cached_property
    def kinked(self) -> Bool[np.ndarray, " slots"]:
        """Which slots are of effects that jump with an input's sign."""
        return np.array([slot.kinked for slot in self.slots], bool)

    @cached_property
    def needs(self) -> dict[str, tuple[str, ...]]:
        """Required columns of each effect, by its id."""
        return {slot.id: slot.needs for slot in self.slots}

    @cached_property
    def largest(self) -> Float[np.ndarray, " slots"]:
        """The size of a coefficient of each slot beyond which it is no cause, base unit."""
        return np.array([slot.largest for slot in self.slots])

    @cached_property
    def _shares(self) -> tuple[Int[np.ndarray, " slots"], Float[np.ndarray, " ids"], Float[np.ndarray, " slots"]]:
        """A number for each slot's id, how often each id is the cause, and the variants' shares."""
        ids = {slot.id: slot.weight for slot in self.slots}
        number = {id: k for k, id in enumerate(ids)}
        shares = np.array([slot.share for slot in self.slots])
        return np.array([number[slot.id] for slot in self.slots], int), np.array([*ids.values()]), shares

    def log_shares(self, shown: Int[np.ndarray, " shown"]) -> Float[np.ndarray, " shown"]:
        """How often each of some slots is the cause where one of them is (log)."""
        ids, weights, shares = self._shares
        own, share = ids[shown], shares[shown]
        variants = np.bincount(own, share, len(weights))
        return np.log(weights[own] / np.sum(weights[variants > 0]) * share / variants[own])

    @cached_property
    def by_width(self) -> dict[int, tuple[Int[np.ndarray, " slots"], Int[np.ndarray, "slots width"]]]:
        """For each number of amplitudes: the slots that have so many, and their columns."""
        widths = np.array([len(slot.columns) for slot in self.slots], int)
        chosen = {width: np.flatnonzero(widths == width) for width in sorted(set(widths.tolist()))}
        return {
            width: (own, np.array([self.slots[k].columns for k in own.tolist()], int)) for width, own in chosen.items()
        }


def key_of(chain: Chain) -> tuple[Any, ...]:
    """Key of a chain: links, names, values."""
    leaves, structure = jax.tree.flatten(chain)
    return structure, tuple(np.asarray(leaf).tobytes() for leaf in leaves)


def hand_held(chain: Chain) -> bool:
    """Whether a chain leaves the attitude of every position free."""
    return any(
        leaf.by == "position" for link in chain.links if isinstance(link, FreeAttitude) for leaf in parameters_of(link)
    )
