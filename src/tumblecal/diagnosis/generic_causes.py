"""Generic terms: what causes that no entry describes can look like. Sparse, and worded, but not named.

Products of inputs, harmonics of the spindle angle (by themselves, times inputs, or at one pitch setting), slow and
sudden changes in measuring order, temperature, and small rotations of the head that follow any of these.
"""

from collections.abc import Iterator
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.diagnosis.causes import NO_SLOT, Cause
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import GENERIC_TEST_WEIGHT, GENERIC_WEIGHT, LEAST_VISIBLE_TERM, SAME_TERM
from tumblecal.effects import AXES, Effect
from tumblecal.estimation.problem import Problem


UNEXPLAINED = "unexplained"
HARMONICS = (1, 2, 3, 4)
_STEP = "step from the"
# So many terms are looked at together: of many positions there are ten thousand.
_TERMS_AT_ONCE = 1024
HEAD_ANGLES = ("index angle", "pitch angle", "tilt across the pitch axis")


class Generic(NamedTuple):
    """What no entry of the catalogue describes: a signal for each coefficient."""

    log_weight: float
    log_test_weight: float
    block: Float[np.ndarray, "nu rank"] | None
    terms: tuple[Float[np.ndarray, " rows"], ...]
    words: str

    label = UNEXPLAINED
    offset = None
    slot = NO_SLOT
    directions = None
    positions = ()
    left_out = ()
    family = None
    named = False

    def undone(self, problem: Problem) -> Problem:
        """The same problem: the term is fitted."""
        return problem

    def told(self, entry: Effect | None, sizes: str) -> str:
        """What it depends on."""
        return f"something that depends like {self.words}; no entry of the catalogue describes it"


def generic_causes(
    at: Tangent, effects: list[Cause], numbers: tuple[int, ...] | None = None
) -> tuple[list[Cause], tuple[int, ...]]:
    """The generic terms that the residuals can show and that no effect of the catalogue covers.

    **Arguments:**

    - `effects`: the causes that are effects.
    - `numbers`: of the terms to take, as returned for the plan; chosen here where left out.

    **Returns:** the causes, and their numbers in the list of all terms.
    """
    terms = _Terms(*zip(*_factors(at), strict=True), of_head=not at.model.hand_held)
    numbers = _distinct(at, terms, effects) if numbers is None else numbers
    words, signals, seen, unit = _seen(at, terms, np.array(numbers, int))
    share = -float(np.log(max(1, len(seen))))
    weights = share + float(np.log(GENERIC_WEIGHT)), share + float(np.log(GENERIC_TEST_WEIGHT))
    blocks, signals = np.ascontiguousarray(unit.T), np.ascontiguousarray(signals[:, seen].T)
    causes: list[Cause] = [
        Generic(*weights, block[:, None], (signal,), words[number])
        for block, signal, number in zip(blocks, signals, seen.tolist(), strict=True)
    ]
    return causes, numbers


class _Terms(NamedTuple):
    """What the terms are made of: each factor in every output, and those that can be of the head at every angle of it."""

    names: tuple[str, ...]
    factors: tuple[Float[np.ndarray, " positions"], ...]
    of_head: bool

    @property
    def turning(self) -> np.ndarray:
        """Numbers of the factors of the head: an unknown error of it turns with the angles and the time, not the inputs.
        None of unknown attitudes, which take up any."""
        return np.array([number for number, name in enumerate(self.names) if self.of_head and "u_" not in name], int)

    @property
    def total(self) -> int:
        """Number of terms."""
        return len(AXES) * len(self.names) + len(HEAD_ANGLES) * len(self.turning)


def _seen(
    at: Tangent, terms: _Terms, numbers: np.ndarray
) -> tuple[list[str], Float[np.ndarray, "rows terms"], np.ndarray, Float[np.ndarray, "nu seen"]]:
    """Words and white rows of some terms, which of them the residuals can show, and their directions there."""
    words, columns = _columns(at, terms, numbers)
    rows = at.problem.rows(columns)
    projected = at.basis[: len(rows)].T @ rows
    size = np.linalg.norm(projected, axis=0)
    seen = np.flatnonzero(size > LEAST_VISIBLE_TERM * np.maximum(np.linalg.norm(rows, axis=0), 1e-300))
    return words, rows, seen, projected[:, seen] / size[seen]


def _distinct(at: Tangent, terms: _Terms, effects: list[Cause]) -> tuple[int, ...]:
    """The terms that the residuals can show and that are neither an effect of the catalogue nor an earlier term.

    A step in time is none of the effects that can imitate it with several coefficients, one for each setting, say.
    """
    kept, directions = [], np.zeros((at.dof, 0))
    for first in range(0, terms.total, _TERMS_AT_ONCE):
        numbers = np.arange(first, min(first + _TERMS_AT_ONCE, terms.total))
        words, _, seen, unit = _seen(at, terms, numbers)
        step = np.array([_STEP in words[number] for number in seen.tolist()], bool)
        covered = np.any(np.abs(directions.T @ unit) > SAME_TERM, axis=0)
        for effect in effects:
            assert effect.block is not None
            same = np.linalg.norm(effect.block.T @ unit, axis=0) > SAME_TERM
            covered |= same & ~(step & (effect.block.shape[1] > 1))
        own, alike = [], np.abs(unit.T @ unit) > SAME_TERM
        for number, same in enumerate(alike):
            if not covered[number]:
                own.append(number)
                covered |= same
        kept += numbers[seen[own]].tolist()
        directions = np.hstack([directions, unit[:, own]])
    return tuple(kept)


def _columns(
    at: Tangent, terms: _Terms, numbers: np.ndarray
) -> tuple[list[str], Float[np.ndarray, "positions 3 terms"]]:
    """Words and signals of some of the generic terms."""
    names, factors, turning = terms.names, np.stack(terms.factors, axis=1), terms.turning
    outputs, count = len(AXES) * len(names), len(factors)
    own, head = numbers[numbers < outputs], numbers[numbers >= outputs] - outputs
    signals = np.zeros((count, 3, len(numbers)))
    signals[:, own // len(names), np.arange(len(own))] = factors[:, own % len(names)]
    probe = at.evaluation.jacobian[:, :, at.model.probe]
    angle, factor = head // max(len(turning), 1), turning[head % max(len(turning), 1)]
    signals[:, :, len(own) :] = probe[:, :, angle] * factors[:, None, factor]
    words = [f"output {AXES[k // len(names)]}: {names[k % len(names)]}" for k in own.tolist()]
    words += [f"{HEAD_ANGLES[a]}: {names[f]}" for a, f in zip(angle.tolist(), factor.tolist(), strict=True)]
    return words, signals


def _factors(at: Tangent) -> Iterator[tuple[str, np.ndarray]]:
    inputs, where = at.evaluation.inputs, at.problem.where
    alpha = np.asarray(where.alpha)
    harmonics = {
        f"{name}({order if order > 1 else ''}alpha)": wave(order * alpha)
        for order in HARMONICS
        for name, wave in (("sin", np.sin), ("cos", np.cos))
    }
    powers = {}
    for degree in (1, 2, 3, 4):
        for axes in combinations_with_replacement(range(3), degree):
            name = " ".join(f"u_{AXES[axis]}^{axes.count(axis)}" for axis in sorted(set(axes))).replace("^1", "")
            powers[name] = np.prod(inputs[:, axes], axis=1)
    yield from ((name, values) for name, values in powers.items() if len(name) > 3)
    yield from harmonics.items()
    for power in [f"u_{axis}" for axis in AXES] + [f"u_{axis}^2" for axis in AXES]:
        yield from ((f"{power} {wave}", powers[power] * values) for wave, values in harmonics.items())
    yield from _grouped(where, harmonics)
    yield from _in_time(where, inputs)


def _grouped(where: Where, harmonics: dict[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    """Harmonics at one pitch setting; constants of one run or mounting."""
    for column, words in (("pitch", "at pitch setting"), ("run", "in run"), ("mount", "in mounting")):
        index = np.asarray(where.index(column))
        groups = np.unique(index)
        for group in groups if len(groups) > 1 else ():
            here = (index == group).astype(float)
            yield f"constant {words} {group + 1}", here
            if column == "pitch":
                yield from ((f"{wave} {words} {group + 1}", here * values) for wave, values in harmonics.items())


def _in_time(where: Where, inputs: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    count = len(np.asarray(where.alpha))
    if where.time_s is not None and np.ptp(np.asarray(where.time_s)) > 0:
        time = np.asarray(where.time_s)
        time, order = (time - time.min()) / np.ptp(time), np.argsort(time, kind="stable")
    else:
        time, order = np.linspace(0.0, 1.0, count), np.arange(count)
    centred = 2 * time - 1
    yield from ((f"time^{power}", centred**power) for power in (1, 2, 3))
    for turns in (1, 2, 3, 4):
        yield f"sin({turns} periods in time)", np.sin(2 * np.pi * turns * time)
        yield f"cos({turns} periods in time)", np.cos(2 * np.pi * turns * time)
    rank = np.empty(count, int)
    rank[order] = np.arange(count)
    for first in range(1, count):
        after = (rank >= first).astype(float)
        if first % max(1, count // 24) == 0:
            yield from (
                (f"u_{axis} {_STEP} {first + 1}th position on", after * inputs[:, place])
                for place, axis in enumerate(AXES)
            )
    if where.temperature_degc is not None:
        warmer = np.asarray(where.temperature_degc)
        warmer = warmer - warmer.mean()
        yield from ((f"temperature^{power}", warmer**power) for power in (2, 3))
