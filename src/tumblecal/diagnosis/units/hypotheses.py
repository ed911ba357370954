"""Hypotheses of the mixed model: shared errors, searched given the random effects and the causes of single units.

As in one data set: the normal equations of the shared signals, summed over the units, are a residual space for `Search`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.cause import EFFECT, Cause
from tumblecal.diagnosis.causes.generic import GENERIC
from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.priors import (
    BATCH_WEIGHT,
    EFFECT_TEST_WEIGHT,
    GENERIC_TEST_WEIGHT,
    GENERIC_WEIGHT,
    HEAD_SPREAD_WEIGHT,
    LEAST_VISIBLE_TERM,
    TAUS_TRIED,
)
from tumblecal.diagnosis.sets.cause_sets import Ranked
from tumblecal.diagnosis.sets.search import Search
from tumblecal.diagnosis.units.batch import Batch, SharedSignal, UnitCauses
from tumblecal.diagnosis.units.mixed_model import ROUNDING, NormalEquations, explained, profiles
from tumblecal.full_model.evidence import gain
from tumblecal.full_model.priors import EFFECT_WEIGHT, VISIBLE
from tumblecal.full_model.visibility import visibilities


# Directions of the summed normal equations below this share of the largest contain only rounding errors.
_ROUNDING = 1e-11


class RandomEffect(NamedTuple):
    """An effect whose amount differs between units: its standard deviation `tau` (scaled units), whether its mean is free, and
    the logarithm of its prior, including the contribution of other values of tau to its evidence."""

    signal: SharedSignal
    tau: float
    with_mean: bool
    log_prior: float

    @property
    def law(self) -> tuple[tuple[int, ...], float]:
        """Columns and standard deviation, as `NormalEquations` needs them."""
        return self.signal.columns, self.tau


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Random effects and causes of single units, with the search of the shared errors given these.

    - `equations`: of every unit; `total`: summed over the units, random effects integrated out.
    - `signals`: of the candidates of `search`, in their order; `ranked`: the sets of shared errors.
    - `log_evidence`: without shared errors, on the scale of all hypotheses less that of the search.
    """

    batch: Batch
    unit_causes: tuple[UnitCauses, ...]
    random_effects: tuple[RandomEffect, ...]
    equations: NormalEquations
    total: NormalEquations
    signals: tuple[SharedSignal, ...]
    log_evidence: float
    search: Search
    ranked: Ranked

    @property
    def top(self) -> float:
        """Log posterior of the best set of shared errors, on a scale common to all hypotheses."""
        return self.log_evidence + self.search.top

    @property
    def without(self) -> float:
        """Log posterior that nothing is shared, on the same scale."""
        return self.log_evidence + self.search.posterior(())

    def coefficients(self, members: Sequence[int]) -> Float[np.ndarray, " columns"]:
        """Least-squares coefficients (scaled) of a set of shared errors and of the means of the random effects, zero
        elsewhere."""
        blocks = [np.zeros((len(self.total.towards), 0))]
        for k in members:
            cause = self.search.pool.causes[k]
            directions = np.ones((1, 1)) if cause.directions is None else cause.directions
            blocks.append(self._embedded(self.signals[k], directions))
        means = (effect.signal for effect in self.random_effects if effect.with_mean)
        directions = np.hstack([*blocks, *(self._embedded(signal, self.mean_directions(signal)) for signal in means)])
        gram = directions.T @ self.total.gram @ directions
        return directions @ (
            np.linalg.pinv(gram, rcond=_ROUNDING, hermitian=True) @ (directions.T @ self.total.towards)
        )

    def mean_directions(self, signal: SharedSignal) -> Float[np.ndarray, "coefficients determined"]:
        """Orthonormal combinations of a random effect's mean coefficients that the units determine."""
        return determined(self.total.of(signal.columns).gram)[0]

    def _embedded(self, signal: SharedSignal, directions: np.ndarray) -> Float[np.ndarray, "columns directions"]:
        embedded = np.zeros((len(self.total.towards), directions.shape[1]))
        embedded[list(signal.columns)] = directions
        return embedded

    def residuals(self, members: Sequence[int]) -> list[Float[np.ndarray, " nu"]]:
        """Of every unit, given a set of shared errors and the most probable deviations of the unit."""
        coefficients = np.tile(self.coefficients(members), (len(self.batch.units), 1))
        for effect in self.random_effects:
            coefficients = coefficients + self.equations.given(coefficients).deviations(*effect.law)
        return [unit.z - unit.response @ each for unit, each in zip(self.batch.units, coefficients, strict=True)]


def hypothesis(
    batch: Batch, unit_causes: Sequence[UnitCauses], random_effects: tuple[RandomEffect, ...] = ()
) -> Hypothesis:
    """Search the shared errors, given the causes of the units and the random effects."""
    equations = marginal = batch.equations(unit_causes)
    for effect in random_effects:
        marginal = marginal.marginal(*effect.law)
    total = reduced = marginal.total
    log_evidence = float(total.log_evidence) + sum(effect.log_prior for effect in random_effects)
    for effect in random_effects:
        if effect.with_mean:
            part = reduced.of(effect.signal.columns)
            axes, information = determined(part.gram)
            squares = (part.towards @ axes) ** 2 / information
            log_evidence += float(gain(np.array(np.sum(squares)), len(information)))
            reduced = reduced.eliminated(effect.signal.columns, axes / information @ axes.T)
    pool, signals, z = _pool(reduced, batch)
    search = Search(pool, z, True)
    ranked = search.run() if len(pool.causes) else search.ranked()
    log_evidence += 0.5 * float(z @ z)
    return Hypothesis(
        batch, tuple(unit_causes), random_effects, equations, total, signals, log_evidence, search, ranked
    )


def determined(
    gram: Float[np.ndarray, "coefficients coefficients"],
) -> tuple[Float[np.ndarray, "coefficients determined"], Float[np.ndarray, " determined"]]:
    """The combinations of coefficients of which the nominal parameters leave enough to see, as columns, and the information
    on each."""
    information, axes = np.linalg.eigh(gram)
    seen = information > max(VISIBLE**2 * information[-1], 1e-300)
    return axes[:, seen], information[seen]


def _pool(equations: NormalEquations, batch: Batch) -> tuple[Pool, tuple[SharedSignal, ...], np.ndarray]:
    """The errors that all units may share as causes in a residual space of the summed normal equations; their signals
    in the same order; and the residual there."""
    norms = np.sqrt(np.maximum(np.diag(batch.squares), 1e-300))
    gram, squares = equations.gram / np.outer(norms, norms), batch.squares / np.outer(norms, norms)
    values, vectors = np.linalg.eigh(gram) if len(gram) else (np.zeros(0), gram)
    kept = values > _ROUNDING * np.max(values, initial=1e-300)
    roots, vectors = np.sqrt(values[kept]), vectors[:, kept]
    rows, z = vectors * roots, (vectors.T @ (equations.towards / norms)) / roots
    of_head = [signal for signal in batch.signals if signal.of_head and len(z)]
    shown: list[tuple[SharedSignal, np.ndarray, np.ndarray | None]] = []
    for signals, columns in _by_width([signal for signal in of_head if signal.is_effect]):
        information, axes = np.linalg.eigh(squares[columns[:, :, None], columns[:, None, :]])
        unprojected = axes * np.sqrt(np.maximum(information, 0.0))[:, None, :]
        every = visibilities(unprojected, rows[columns], VISIBLE, 0.0)
        seen = [every.of(number, signal.slot) for number, signal in enumerate(signals)]
        for signal, own in zip(signals, seen, strict=True):
            if own.block.shape[1]:
                shown.append((signal, own.block, own.directions / norms[list(signal.columns)][:, None]))
    effects = len(shown)
    for signal in of_head:
        size = np.linalg.norm(row := rows[list(signal.columns)])
        if not signal.is_effect and size > LEAST_VISIBLE_TERM:
            shown.append((signal, row.T / size, None))
    shown.sort(key=lambda row: row[0].columns)
    # A kind shares its weight among its candidates.
    kinds = {
        EFFECT: (effects, EFFECT_WEIGHT, EFFECT_TEST_WEIGHT),
        GENERIC: (len(shown) - effects, GENERIC_WEIGHT, GENERIC_TEST_WEIGHT),
    }
    causes = []
    for signal, block, directions in shown:
        count, weight, test_weight = kinds[kind := EFFECT if signal.is_effect else GENERIC]
        logs = float(np.log(weight / count)), float(np.log(test_weight / count))
        cause = Cause(kind, signal.label, *logs, block, slot=signal.slot, directions=directions, words=signal.words)
        causes.append(cause)
    return Pool.of(causes, len(z)), tuple(signal for signal, _, _ in shown), z


def _by_width(
    signals: Sequence[SharedSignal],
) -> Iterator[tuple[list[SharedSignal], Int[np.ndarray, "signals coefficients"]]]:
    """The signals with equally many coefficients together, and their columns."""
    for width in sorted({len(signal.columns) for signal in signals}):
        listed = [signal for signal in signals if len(signal.columns) == width]
        yield listed, np.array([signal.columns for signal in listed])


def likely_random_effects(
    equations: NormalEquations, signals: Sequence[SharedSignal], most: int
) -> list[tuple[float, RandomEffect]]:
    """The effects that random amounts explain best, with their log odds against none, from the normal equations of every unit
    that the other errors leave; each at its best spread, of those that at least two units show."""
    effects = [signal for signal in signals if signal.is_effect]
    of_head = sum(signal.of_head for signal in effects)
    weights = BATCH_WEIGHT / max(1, len(effects) - of_head), HEAD_SPREAD_WEIGHT / max(1, of_head)
    scored: list[tuple[float, RandomEffect]] = []
    for of_width, columns in _by_width(effects):
        gram = equations.gram[:, columns[:, :, None], columns[:, None, :]].swapaxes(0, 1)
        largest = np.maximum(np.linalg.eigvalsh(gram)[..., -1], 0.0)
        size = np.sqrt(np.mean(largest, axis=1))
        shown = np.flatnonzero((size > ROUNDING) & (np.sum(largest > ROUNDING * size[:, None] ** 2, axis=1) > 1))
        taus, towards, logs = np.array(TAUS_TRIED)[:, None] / size[shown], equations.towards[:, columns[shown]], []
        for at in profiles(gram[shown], towards.swapaxes(0, 1)[:, None], taus):
            logs += [at.about_zero[:, 0], at.about_zero[:, 0] + gain(*explained(at.gram, at.towards[:, 0]))]
        odds, best = np.logaddexp.reduce(logs) - np.log(len(logs)), np.argmax(logs, axis=0).tolist()
        for column, (number, row) in enumerate(zip(shown.tolist(), best, strict=True)):
            log_odds = float(odds[column] + np.log(weights[of_width[number].of_head]))
            log_prior, tau = log_odds - float(logs[row][column]), float(taus[row // 2, column])
            scored.append((log_odds, RandomEffect(of_width[number], tau, row % 2 == 1, log_prior)))
    return sorted(scored, key=lambda pair: -pair[0])[:most]
