"""The causes that are effects of the catalogue."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int

from tumblecal.diagnosis.causes.cause import EFFECT, Cause, family_of
from tumblecal.diagnosis.causes.table import Pool
from tumblecal.diagnosis.priors import EFFECT_TEST_WEIGHT, LEAST_POSSIBLE, SECOND_ORDER
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.priors import EFFECT_WEIGHT, VISIBLE
from tumblecal.full_model.tangent import Tangent
from tumblecal.full_model.visibility import Visibilities, Visibility, least_signal, visibilities
from tumblecal.ground.showing import brief


@dataclass(frozen=True)
class SeenEffects:
    """The visibility of every effect of a model.

    - `slots`: of the effects; `groups`: for each number of coefficients the effects that have so many, and their visibility.
    - `moved`: which effects act where the model is linearised.
    """

    __repr__ = brief

    slots: tuple[Slot, ...]
    groups: tuple[tuple[Int[np.ndarray, " own"], Visibilities], ...]
    moved: Bool[np.ndarray, " effects"]

    @cached_property
    def ranks(self) -> Int[np.ndarray, " effects"]:
        """How many directions of each effect the residuals can show."""
        ranks = np.zeros(len(self.slots), int)
        for numbers, seen in self.groups:
            ranks[numbers] = seen.shown.sum(axis=1)
        return ranks

    @cached_property
    def absorbed(self) -> Int[np.ndarray, " absorbed"]:
        """The effects of which the nominal model takes up some direction whole."""
        return np.sort(np.concatenate([numbers[~seen.shown.all(axis=1)] for numbers, seen in self.groups]))

    @cached_property
    def sizes(self) -> list[tuple[list[float], list[float]]]:
        """For each effect `projected` and `whole` of its `Visibility`."""
        by_number: dict[int, tuple[list[float], list[float]]] = {}
        for numbers, seen in self.groups:
            pairs = zip(seen.projected.tolist(), seen.whole.tolist(), strict=True)
            by_number |= dict(zip(numbers.tolist(), pairs, strict=True))
        return [by_number[number] for number in range(len(self.slots))]

    @cached_property
    def _rows(self) -> dict[int, tuple[Visibilities, int]]:
        """Group and row of each effect."""
        return {number: (seen, row) for numbers, seen in self.groups for row, number in enumerate(numbers.tolist())}

    def of(self, number: int) -> Visibility:
        """The visibility of one effect."""
        seen, row = self._rows[number]
        return seen.of(row, self.slots[number])

    def __iter__(self) -> Iterator[Visibility]:
        return (self.of(number) for number in range(len(self.slots)))


def seen_effects(at: Tangent) -> SeenEffects:
    """The visibility of every effect, in the model's order."""
    layout, varying, seen = at.model.layout, at.varying.T, at.jacobian.T @ at.basis
    moved, groups, rounding = np.zeros(len(layout.slots), bool), [], least_signal(at)
    for numbers, columns in layout.by_width.values():
        moved[numbers] = np.any(at.vector[columns], axis=1)
    second_order = _moved_or_equal(at, moved)
    for numbers, columns in layout.by_width.values():
        # Around the exact fit of an effect nothing is lost to the linearisation: what shows of it in the second order counts.
        share = np.where(second_order[numbers], SECOND_ORDER, VISIBLE)
        # Nor shows what the noise hides of the largest coefficient that a head may have.
        possible = layout.largest[numbers] / at.model.scales[columns].min(axis=1)
        least = np.maximum(rounding, LEAST_POSSIBLE * at.rough_level / possible)
        split = visibilities(varying[columns], seen[columns], share, least)
        # Nor is a direction the effect's along which the data show more than such a coefficient makes.
        sizes = np.linalg.norm(split.turned[:, :, : split.signals.shape[1]].mT @ seen[columns], axis=2)
        too_far = np.abs(split.signals @ at.z) / possible[:, None] > sizes
        split.shown[:, : too_far.shape[1]] &= ~(too_far & ~moved[numbers, None])
        groups.append((numbers, split))
    return SeenEffects(layout.slots, tuple(groups), moved)


def _moved_or_equal(at: Tangent, moved: Bool[np.ndarray, " effects"]) -> Bool[np.ndarray, " effects"]:
    """Those moved, and those that are another at each group of the same settings on the same axis: where an input is the same
    all through a setting, bias and scale factor by setting make the same signals, and neither may have fewer directions."""
    if not moved.any():
        return moved
    groups = at.problem.where.groups
    goes_by = [tuple([name for name in slot.needs if name in groups]) for slot in at.model.layout.slots]
    families = (family_of(slot.id) for slot in at.model.layout.slots)
    keys = [(family[1], own) if family and own else None for family, own in zip(families, goes_by, strict=True)]
    there = {key for key, moves in zip(keys, moved.tolist(), strict=True) if moves and key}
    return moved | np.array([key in there for key in keys], bool)


def effect_causes(at: Tangent, seen: SeenEffects, visible: frozenset[str] | None = None) -> Pool:
    """Candidates for every visible effect.

    **Arguments:**

    - `seen`: the visibility of all of them.
    - `visible`: the effects that are visible without any error. Given a large effect, others seem to be visible that only
      change its size. If omitted, all that are visible here.
    """
    layout, numbers = at.model.layout, np.flatnonzero(seen.ranks)
    shares = layout.log_shares(numbers)
    if visible is not None:
        # Of one that jumps with an input's sign, what is visible hangs on the signs: on where the model is linearised.
        listed = np.array([slot.id in visible for slot in seen.slots], bool)
        kept = (listed | layout.kinked | seen.moved)[numbers]
        numbers, shares = numbers[kept], shares[kept]
    slots = [seen.slots[number] for number in numbers.tolist()]
    rows = np.concatenate([own.rows for _, own in seen.groups])
    owners = np.concatenate([np.repeat(own, seen.ranks[own]) for own, _ in seen.groups])
    taken = np.isin(owners, numbers)

    def made(k: int, cause: Cause) -> Cause:
        return cause._replace(directions=seen.of(int(numbers[k])).directions)

    weights = shares + np.log(EFFECT_WEIGHT), shares + np.log(EFFECT_TEST_WEIGHT)
    owners = np.searchsorted(numbers, owners[taken])
    return Pool.of_kind(EFFECT, [slot.id for slot in slots], weights, rows[taken], owners, made, slots)
