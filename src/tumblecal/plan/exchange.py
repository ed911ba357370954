"""Positions by randomised exchange with restarts, under the time that they take on the head.

A position is removed, and the best cell that the head can measure in the time is added (Cook and Nachtsheim 1980, Technometrics
22, 315). Whole pitch settings are closed and opened too, because their time is shared by several positions; mountings and
temperatures are enumerated for the same reason.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Int

from tumblecal.plan.limits import Limits, in_order
from tumblecal.plan.set_value import SetValue, Term


# An exchange counts if it reduces the value by more than this share; a pass of them, if by more than the second one.
_GAIN, _OF_PASS = 1e-6, 1e-5
# Largest number of passes, and of positions that are tried in each.
_PASSES, _TRIED = 30, 48
# Largest number of sets of mountings and temperatures that are tried.
_SETS = 31


@dataclass(frozen=True)
class Chosen:
    """Chosen cells in an order that visits each setting once, and their value."""

    cells: Int[np.ndarray, " positions"]
    value: float


def exchange(
    limits: Limits,
    terms: Sequence[Term],
    *,
    restarts: int = 4,
    seed: int = 0,
    starts: Sequence[Sequence[int] | np.ndarray] = (),
) -> Chosen:
    """The cells with the least value within limits.

    **Arguments:**

    - `restarts`: from random positions; with limited time, of each set of mountings and temperatures, in rounds of half of
      the sets that remain (the first without changes of whole pitch settings). `starts`: positions to begin with in addition.
    """
    rng = np.random.default_rng(seed)
    found = [_improved(limits, terms, rng, start, whole=True) for start in starts]
    sets = _sets(limits, rng)
    for number in range(restarts if starts else max(1, restarts)):
        within = [replace(limits, allowed=limits.allowed & one) for one in sets]
        whole = len(sets) == 1 or number > 0
        tried = [_improved(each, terms, rng, _random(each, rng), whole=whole) for each in within]
        order = np.argsort([one.value for one in tried], kind="stable")
        sets = [sets[k] for k in order[: (len(sets) + 1) // 2]]
        found += tried
    best = min(found, key=lambda one: one.value)
    return Chosen(in_order(limits.cells, best.cells, limits.present), best.value)


def _sets(limits: Limits, rng: np.random.Generator) -> list[Bool[np.ndarray, " cells"]]:
    """Cells of each set of mountings and temperatures of which one position each fits; without a limit of time all at once,
    since none costs anything."""
    if not limits.timed:
        return [limits.allowed]
    first, sitting = _one_each(limits), limits.cells.sitting
    sets = (np.array(one) for size in range(1, len(first) + 1) for one in combinations(first.tolist(), size))
    listed = [one for one in sets if not limits.exceeded(np.bincount(one, minlength=len(sitting)))]
    some = np.sort(rng.permutation(len(listed))[:_SETS])
    return [np.isin(sitting, sitting[listed[k]]) for k in some]


def _one_each(limits: Limits) -> Int[np.ndarray, " sittings"]:
    """The first allowed cell of each mounting and temperature."""
    allowed = np.flatnonzero(limits.allowed)
    return allowed[np.unique(limits.cells.sitting[allowed], return_index=True)[1]]


def _random(limits: Limits, rng: np.random.Generator) -> list[int]:
    """Random cells, as many as fit; with limited time, one of each mounting and temperature, then of a random number of pitch
    settings."""
    group, allowed, number = limits.cells.group, np.flatnonzero(limits.allowed), np.zeros(len(limits.cells), int)
    first = rng.permutation(allowed)
    if limits.timed:
        groups = rng.permutation(np.unique(group[allowed]))
        some = allowed[np.isin(group[allowed], groups[: rng.integers(1, len(groups) + 1)])]
        first = np.concatenate([rng.permutation(_one_each(limits)), rng.permutation(some), first])
    for cell in first:
        while limits.fits(number)[cell]:
            number[cell] += 1
    return np.repeat(np.arange(len(number)), number).tolist()


def _improved(
    limits: Limits, terms: Sequence[Term], rng: np.random.Generator, start: Sequence[int] | np.ndarray, *, whole: bool
) -> SetValue:
    """A start, without its least valuable positions if it exceeds the limits, exchanged until nothing improves; with limited
    time also `whole` pitch settings."""
    plan = SetValue(terms, start)
    while plan.cells and limits.exceeded(_number(limits, plan)):
        plan.remove(plan.cells[int(np.argmin(plan.if_removed()))])
    _fill(limits, plan)
    for _ in range(_PASSES):
        _exchange(limits, plan, rng)
        other = _regrouped(limits, terms, plan, rng) if whole and limits.timed else plan
        if other is plan:
            break
        plan = other
    return plan


def _number(limits: Limits, plan: SetValue) -> Int[np.ndarray, " cells"]:
    """Number of positions in each cell."""
    return np.bincount(np.array(plan.cells, int), minlength=len(limits.cells))


def _best(plan: SetValue, fits: Bool[np.ndarray, " cells"]) -> tuple[int, float]:
    """The best cell for one more position, and the value with it; infinite if none fits."""
    some = np.flatnonzero(fits)
    if not len(some):
        return -1, np.inf
    values = plan.if_added(some)
    return int(some[np.argmin(values)]), float(values.min())


def _fill(limits: Limits, plan: SetValue) -> None:
    """Add the best position as long as one fits."""
    while (cell := _best(plan, limits.fits(_number(limits, plan)))[0]) >= 0:
        plan.add(cell)


def _exchange(limits: Limits, plan: SetValue, rng: np.random.Generator) -> None:
    """Exchange single positions, those that are missed least, in random order, until a whole pass improves nothing."""
    for _ in range(_PASSES):
        before, least = plan.value, np.argsort(plan.if_removed(), kind="stable")[:_TRIED]
        for cell in rng.permutation(np.array(plan.cells)[least]).tolist():
            had = plan.value
            plan.remove(cell)
            other, value = _best(plan, limits.fits(_number(limits, plan)))
            plan.add(other if value < had * (1 - _GAIN) else cell)
        _fill(limits, plan)
        if plan.value > before * (1 - _OF_PASS):
            return


def _regrouped(limits: Limits, terms: Sequence[Term], plan: SetValue, rng: np.random.Generator) -> SetValue:
    """Each pitch setting closed, or each other one opened in place of the least valuable positions, if that is better; the plan
    itself if nothing is."""
    groups = limits.cells.group
    for group in rng.permutation(np.unique(groups[limits.allowed])).tolist():
        others = [cell for cell in plan.cells if groups[cell] != group]
        other = SetValue(terms, others)
        if len(others) == len(plan.cells):
            _open(limits, other, group)
        _fill(limits, other)
        plan = other if other.value < plan.value * (1 - _GAIN) else plan
    return plan


def _open(limits: Limits, plan: SetValue, group: int) -> None:
    """Add two positions of a pitch setting, after removing others until they fit."""
    groups = limits.cells.group
    for _ in range(2):
        while not np.any(fits := limits.fits(_number(limits, plan)) & (groups == group)):
            others = groups[plan.cells] != group
            if not np.any(others):
                return
            plan.remove(plan.cells[int(np.argmin(np.where(others, plan.if_removed(), np.inf)))])
        plan.add(_best(plan, fits)[0])
