"""Generic terms: signals of causes that are not in the catalogue. They are sparse and described in words, but not named.

Products of inputs, harmonics of the spindle angle (by themselves, times inputs, or at one pitch setting), slow and
sudden changes in measuring order, temperature, and small rotations of the head that follow any of these.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations_with_replacement, pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Where
from tumblecal.diagnosis.causes.cause import Cause, Kind
from tumblecal.diagnosis.causes.table import CauseTable, equally_weighted
from tumblecal.diagnosis.priors import GENERIC_TEST_WEIGHT, GENERIC_WEIGHT, LEAST_VISIBLE_TERM, SAME_TERM
from tumblecal.effects import AXES
from tumblecal.effects.effect import elapsed
from tumblecal.full_model.tangent import Tangent


UNEXPLAINED = "unexplained"
HARMONICS = (1, 2, 3, 4)
_STEP = "step from the"
# So many terms are looked at together: of many positions there are ten thousand.
_TERMS_AT_ONCE = 1024
_WAVES = ("sin", "cos")
# The inputs of each product, by degree; and which products, counted through all degrees, harmonics are taken times.
_PRODUCTS = tuple(tuple(combinations_with_replacement(range(3), degree)) for degree in (1, 2, 3, 4))
_TIMES_HARMONICS = (0, 1, 2, 3, 6, 8)
# Of each product beyond the inputs the product that it is a multiple of, in the degree before, and of which input.
_MULTIPLES = [
    np.array([(shorter.index(axes[:-1]), axes[-1]) for axes in longer]).T for shorter, longer in pairwise(_PRODUCTS)
]
HEAD_ANGLES = ("index angle", "pitch angle", "tilt across the pitch axis")


# What no entry of the catalogue describes: a signal for each coefficient.
GENERIC = Kind("generic", named=False)


def generic_causes(
    at: Tangent, effects: CauseTable, numbers: tuple[int, ...] | None = None
) -> tuple[CauseTable, tuple[int, ...]]:
    """The generic terms that the residuals can show and that no effect of the catalogue covers.

    **Arguments:**

    - `effects`: the causes that are effects.
    - `numbers`: of the terms to use, as returned for the plan; if omitted, they are selected here.

    **Returns:** the causes, and their numbers in the list of all terms.
    """
    plan = _plan(at)
    terms = _Terms(_names(plan), _factors(at, plan), not at.model.hand_held)
    numbers = _distinct(at, terms, effects) if numbers is None else numbers
    seen, unit = _seen(at, terms, numbers)
    words, share = _words(terms.names, terms.of_head, numbers), -float(np.log(max(1, len(seen))))

    signals = _Rows(at, terms, tuple([numbers[k] for k in seen.tolist()]))

    def made(k: int, label: str, weights: tuple[float, float], block: np.ndarray) -> Cause:
        return Cause(GENERIC, label, *weights, block, terms=(signals.white[:, k].copy(),), words=words[seen[k]])

    weights = share + float(np.log(GENERIC_WEIGHT)), share + float(np.log(GENERIC_TEST_WEIGHT))
    return equally_weighted(GENERIC, [UNEXPLAINED] * len(seen), weights, unit, None, made), numbers


@dataclass(frozen=True)
class _Rows:
    """White rows of some of the terms, made when the first of them is asked for."""

    at: Tangent
    terms: "_Terms"
    numbers: tuple[int, ...]

    @cached_property
    def white(self) -> Float[np.ndarray, "rows terms"]:
        """The rows, one column for each term."""
        return self.at.problem.rows(self.terms.signals(self.at, self.numbers))


class _Terms(NamedTuple):
    """What the terms are made of: each factor in every output, and those that can be of the head at every angle of it."""

    names: tuple[str, ...]
    factors: Float[np.ndarray, "positions factors"]
    of_head: bool

    @property
    def total(self) -> int:
        """Number of terms."""
        return len(AXES) * len(self.names) + len(HEAD_ANGLES) * len(_turning(self.names, self.of_head))

    def signals(self, at: Tangent, numbers: tuple[int, ...]) -> Float[np.ndarray, "positions 3 terms"]:
        """Signals of some of the terms."""
        times, factor = _made_of(self.names, self.of_head, numbers)
        probe = at.evaluation.jacobian[:, :, at.model.probe]
        each = np.concatenate([np.broadcast_to(np.eye(3), probe.shape), probe], axis=2)
        return each[:, :, times] * self.factors[:, None, factor]

    def projected(self, at: Tangent, numbers: tuple[int, ...]) -> Float[np.ndarray, "terms nu"]:
        """The signals of the terms in the residual space, as rows; `numbers` in ascending order."""
        times, factor = _made_of(self.names, self.of_head, numbers)
        outputs, probe = at.responses.transpose(1, 2, 0), at.evaluation.jacobian[:, :, at.model.probe]
        each = np.concatenate([outputs, probe.mT @ outputs], axis=1).swapaxes(0, 1)
        bounds = np.searchsorted(times, np.arange(len(each) + 1)).tolist()
        projected = np.empty((len(factor), at.dof))
        for own, (first, last) in zip(each, pairwise(bounds), strict=True):
            np.matmul(self.factors[:, factor[first:last]].T, own, out=projected[first:last])
        return projected

    def norms(self, at: Tangent, numbers: tuple[int, ...]) -> Float[np.ndarray, " terms"]:
        """Norms of their white rows."""
        if at.problem.correlated:
            return np.linalg.norm(at.problem.rows(self.signals(at, numbers)), axis=0)
        squares, probe = at.whole_responses**2, at.evaluation.jacobian[:, :, at.model.probe]
        each = np.concatenate([squares, (probe**2 * squares[:, :, None]).sum(axis=1)], axis=1)
        return np.sqrt(each.T @ self.factors**2)[_made_of(self.names, self.of_head, numbers)]


@lru_cache(maxsize=64)
def _turning(names: tuple[str, ...], of_head: bool) -> tuple[int, ...]:
    """Numbers of the factors of the head: an unknown error of it turns with the angles and the time, not the inputs. None of
    unknown attitudes, which take up any."""
    return tuple(number for number, name in enumerate(names) if of_head and "u_" not in name)


@lru_cache(maxsize=64)
def _made_of(
    names: tuple[str, ...], of_head: bool, numbers: tuple[int, ...]
) -> tuple[Int[np.ndarray, " terms"], Int[np.ndarray, " terms"]]:
    """Of some terms the output or, counted on, the angle of the head, and the factor."""
    turning = np.array(_turning(names, of_head), int)
    times = [
        *np.repeat(np.arange(len(AXES)), len(names)),
        *np.repeat(len(AXES) + np.arange(len(HEAD_ANGLES)), len(turning)),
    ]
    factor = [*np.tile(np.arange(len(names)), len(AXES)), *np.tile(turning, len(HEAD_ANGLES))]
    return np.array(times, int)[list(numbers)], np.array(factor, int)[list(numbers)]


@lru_cache(maxsize=64)
def _words(names: tuple[str, ...], of_head: bool, numbers: tuple[int, ...]) -> tuple[str, ...]:
    """What each of some terms is."""
    kinds = [*(f"output {axis}" for axis in AXES), *HEAD_ANGLES]
    times, factor = (own.tolist() for own in _made_of(names, of_head, numbers))
    return tuple(f"{kinds[kind]}: {names[number]}" for kind, number in zip(times, factor, strict=True))


def _seen(
    at: Tangent, terms: _Terms, numbers: tuple[int, ...]
) -> tuple[Int[np.ndarray, " seen"], Float[np.ndarray, "seen nu"]]:
    """Which of some terms the residuals can show, and their directions there, as rows."""
    projected = terms.projected(at, numbers)
    size = np.sqrt(np.vecdot(projected, projected))
    seen = np.flatnonzero(size > LEAST_VISIBLE_TERM * np.maximum(terms.norms(at, numbers), 1e-300))
    return seen, projected[seen] / size[seen, None]


def _distinct(at: Tangent, terms: _Terms, effects: CauseTable) -> tuple[int, ...]:
    """The terms that the residuals can show and that are neither an effect of the catalogue nor an earlier term.

    A step in time is none of the effects that can imitate it with several coefficients, one for each setting, say.
    """
    kept, directions = [], np.zeros((0, at.dof))
    first_rows = np.searchsorted(effects.owners, np.arange(len(effects)))
    several = np.bincount(effects.owners, minlength=len(effects))[:, None] > 1
    for first in range(0, terms.total, _TERMS_AT_ONCE):
        numbers = tuple(range(first, min(first + _TERMS_AT_ONCE, terms.total)))
        words = _words(terms.names, terms.of_head, numbers)
        seen, unit = _seen(at, terms, numbers)
        step = np.array([_STEP in words[number] for number in seen.tolist()], bool)
        covered = np.any(np.abs(directions @ unit.T) > SAME_TERM, axis=0)
        same = np.sqrt(np.add.reduceat((effects.rows @ unit.T) ** 2, first_rows)) > SAME_TERM
        covered |= np.any(same & ~(step & several), axis=0)
        own, near = [], np.abs(unit @ unit.T) > SAME_TERM
        for number, same in enumerate(near):
            if not covered[number]:
                own.append(number)
                covered |= same
        kept += [numbers[number] for number in seen[own].tolist()]
        directions = np.concatenate([directions, unit[own]])
    return tuple(kept)


class _Plan(NamedTuple):
    """What decides which factors there are: the groups, the number of positions, whether temperature is known."""

    pitch: tuple[int, ...]
    run: tuple[int, ...]
    mount: tuple[int, ...]
    positions: int
    thermal: bool


def _plan(at: Tangent) -> _Plan:
    where = at.problem.where

    def several(column: str) -> tuple[int, ...]:
        groups = sorted(set(np.asarray(where.index(column)).tolist()))
        return tuple(groups) if len(groups) > 1 else ()

    thermal = where.temperature_degc is not None
    return _Plan(several("pitch"), several("run"), several("mount"), len(np.asarray(where.alpha)), thermal)


def _firsts(count: int) -> list[int]:
    """Where in the measuring order steps begin."""
    return [first for first in range(1, count) if first % max(1, count // 24) == 0]


@lru_cache(maxsize=64)
def _names(plan: _Plan) -> tuple[str, ...]:
    """Names of all factors, in the order of `_factors`."""
    harmonics = [f"{wave}({order if order > 1 else ''}alpha)" for order in HARMONICS for wave in _WAVES]
    powers = [
        " ".join(f"u_{AXES[axis]}^{axes.count(axis)}" for axis in sorted(set(axes))).replace("^1", "")
        for of_degree in _PRODUCTS
        for axes in of_degree
    ]
    names = [*powers[3:], *harmonics]
    names += [f"{powers[number]} {wave}" for number in _TIMES_HARMONICS for wave in harmonics]
    for column, words in (("pitch", "at pitch setting"), ("run", "in run"), ("mount", "in mounting")):
        kinds = ["constant", *(harmonics if column == "pitch" else [])]
        names += [f"{kind} {words} {group + 1}" for group in getattr(plan, column) for kind in kinds]
    names += [f"time^{power}" for power in (1, 2, 3)]
    names += [f"{wave}({turns} periods in time)" for turns in (1, 2, 3, 4) for wave in _WAVES]
    names += [f"u_{axis} {_STEP} {first + 1}th position on" for first in _firsts(plan.positions) for axis in AXES]
    return (*names, *((f"temperature^{power}" for power in (2, 3)) if plan.thermal else ()))


def _factors(at: Tangent, plan: _Plan) -> Float[np.ndarray, "positions factors"]:
    """Products of inputs, harmonics, their products, what is of one group alone, what follows the time or the temperature."""
    inputs, where = at.evaluation.inputs, at.problem.where
    groups = tuple(tuple(np.asarray(where.index(column)).tolist()) for column in ("pitch", "run", "mount"))
    waves, grouped = _of_settings(plan, tuple(np.asarray(where.alpha).tolist()), groups)
    products = [inputs]
    for shorter, axis in _MULTIPLES:
        products.append(products[-1][:, shorter] * inputs[:, axis])
    powers = np.concatenate(products, axis=1)
    crossed = (powers[:, _TIMES_HARMONICS, None] * waves[:, None]).reshape(len(waves), -1)
    listed = [powers[:, 3:], waves, crossed, grouped, *_in_time(where, inputs)]
    if where.temperature_degc is not None:
        warmer = np.asarray(where.temperature_degc)
        listed.append((warmer - warmer.mean())[:, None] ** np.array([2, 3]))
    return np.concatenate(listed, axis=1)


@lru_cache(maxsize=64)
def _of_settings(
    plan: _Plan, alpha: tuple[float, ...], groups: tuple[tuple[int, ...], ...]
) -> tuple[Float[np.ndarray, "positions waves"], Float[np.ndarray, "positions grouped"]]:
    """Harmonics, and what is of one group alone; `groups`: pitch setting, run and mounting of every position."""
    waves = _sines(np.array(alpha)[:, None] * np.array(HARMONICS))
    grouped = list[np.ndarray]()
    # Harmonics at one pitch setting; constants of one run or mounting.
    for column, own in zip(("pitch", "run", "mount"), groups, strict=True):
        here = (np.array(own)[:, None] == np.array(getattr(plan, column), int)).astype(float)[:, :, None]
        of_group = np.concatenate([here, here * waves[:, None]], axis=2) if column == "pitch" else here
        grouped.append(of_group.reshape(len(waves), -1))
    return waves, np.concatenate(grouped, axis=1)


def _sines(angles: Float[np.ndarray, "positions orders"]) -> Float[np.ndarray, "positions waves"]:
    """Sine and cosine of each angle in turn."""
    return np.stack([np.sin(angles), np.cos(angles)], axis=2).reshape(len(angles), -1)


def _in_time(where: Where, inputs: Float[np.ndarray, "positions 3"]) -> Iterator[np.ndarray]:
    """Powers and swings of the time, steps in it of every axis."""
    count = len(inputs)
    if where.time_s is not None and np.ptp(np.asarray(where.time_s)) > 0:
        time = np.asarray(where.time_s)
        # By each clock from its own first position on: over a pause of unknown length nothing is supposed.
        since, order = np.asarray(elapsed(where)), np.argsort(time, kind="stable")
        time = since / (np.max(since) or 1.0)
    else:
        time, order = np.linspace(0.0, 1.0, count), np.arange(count)
    yield (2 * time - 1)[:, None] ** np.array([1, 2, 3])
    yield _sines(2 * np.pi * time[:, None] * np.array([1, 2, 3, 4]))
    rank = np.empty(count, int)
    rank[order] = np.arange(count)
    after = rank[:, None] >= np.array(_firsts(count), int)
    yield (after[:, :, None] * inputs[:, None]).reshape(count, -1)
