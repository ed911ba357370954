"""Hypotheses of the mixed model: errors shared by all units with one coefficient, effects that each unit has by a different
amount (random effects), and causes of single units. The shared errors are searched given the other two.

As in one data set: the normal equations of the shared signals, summed over the units, are a residual space for `Search`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import EFFECT, GENERIC, Cause
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
from tumblecal.diagnosis.sets.cause_sets import Members, Ranked
from tumblecal.diagnosis.sets.search import Search
from tumblecal.diagnosis.units.mixed_model import ROUNDING, NormalEquations, explained
from tumblecal.diagnosis.units.unit import Batch, SharedSignal
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
    unit_causes: tuple[Members, ...]
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

    @property
    def means(self) -> list[tuple[SharedSignal, Float[np.ndarray, "coefficients determined"]]]:
        """The random effects with a mean, and the combinations of coefficients of each that the units determine."""
        signals = [effect.signal for effect in self.random_effects if effect.with_mean]
        return [(signal, determined(self.total.of(signal.columns).gram)[0]) for signal in signals]

    def axes(self, members: Sequence[int]) -> list[tuple[SharedSignal, Float[np.ndarray, "coefficients determined"]]]:
        """The signals of a set of shared errors with their visible combinations of coefficients, orthonormal."""
        directions = [self.search.pool.causes[k].directions for k in members]
        axes = (np.ones((1, 1)) if own is None else np.linalg.qr(own)[0] for own in directions)
        return list(zip([self.signals[k] for k in members], axes, strict=True))

    def coefficients(self, members: Sequence[int]) -> Float[np.ndarray, " columns"]:
        """Least-squares coefficients (scaled) of a set of shared errors and of the means of the random effects, zero
        elsewhere."""
        directions = embedded([*self.axes(members), *self.means], len(self.total.towards))
        own = self.total.along(directions)
        return directions @ (np.linalg.pinv(own.gram, rcond=_ROUNDING, hermitian=True) @ own.towards)

    def residuals(self, members: Sequence[int]) -> list[Float[np.ndarray, " nu"]]:
        """Of every unit, given a set of shared errors and the most probable deviations of the unit."""
        own = np.tile(self.coefficients(members), (len(self.batch.units), 1))
        for effect in self.random_effects:
            own = own + self.equations.given(own).deviations(*effect.law)
        return [unit.z - unit.response @ each for unit, each in zip(self.batch.units, own, strict=True)]


def embedded(parts: Sequence[tuple[SharedSignal, np.ndarray]], width: int) -> Float[np.ndarray, "width directions"]:
    """Combinations of the coefficients of some signals, side by side, among all columns."""
    rows = [np.zeros((width, 0))]
    for signal, axes in parts:
        rows.append(np.zeros((width, axes.shape[1])))
        rows[-1][list(signal.columns)] = axes
    return np.hstack(rows)


def hypothesis(
    batch: Batch, unit_causes: Sequence[Members], random_effects: tuple[RandomEffect, ...] = ()
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
    ranked = search.run() if pool.size else search.ranked()
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
    shown: list[tuple[SharedSignal, np.ndarray, np.ndarray | None]] = []
    for signal in batch.signals if len(z) else ():
        columns, size = list(signal.columns), np.linalg.norm(rows[list(signal.columns)])
        if signal.of_head and signal.is_effect:
            information, axes = np.linalg.eigh(squares[np.ix_(columns, columns)])
            unprojected = axes * np.sqrt(np.maximum(information, 0.0))
            seen = visibilities(unprojected[None], rows[None, columns], VISIBLE, 0.0).of(0, signal.slot)
            if seen.block.shape[1]:
                shown.append((signal, seen.block, seen.directions / norms[columns][:, None]))
        elif signal.of_head and size > LEAST_VISIBLE_TERM:
            shown.append((signal, rows[columns].T / size, None))
    causes, effects = [], sum(signal.is_effect for signal, *_ in shown)
    for signal, block, directions in shown:
        # A kind shares its weight among its candidates.
        kind, weight, test_weight, count = (
            (EFFECT, EFFECT_WEIGHT, EFFECT_TEST_WEIGHT, effects)
            if signal.is_effect
            else (GENERIC, GENERIC_WEIGHT, GENERIC_TEST_WEIGHT, len(shown) - effects)
        )
        logs = float(np.log(weight / count)), float(np.log(test_weight / count))
        own = {"slot": signal.slot, "directions": directions, "words": signal.words}
        causes.append(Cause(kind, signal.label, *logs, block, **own))
    return Pool.of(causes, len(z)), tuple(signal for signal, *_ in shown), z


def likely_random_effects(
    equations: NormalEquations, signals: Sequence[SharedSignal], most: int
) -> list[tuple[float, RandomEffect]]:
    """The effects that random amounts explain best, with their log odds against none, from the normal equations of every unit
    that the other errors leave; each at its best spread, of those that at least two units show."""
    effects = [signal for signal in signals if signal.is_effect]
    of_head = sum(signal.of_head for signal in effects)
    weights = BATCH_WEIGHT / max(1, len(effects) - of_head), HEAD_SPREAD_WEIGHT / max(1, of_head)
    scored: list[tuple[float, RandomEffect]] = []
    for signal in effects:
        own = equations.of(signal.columns)._replace(log_evidence=0.0)
        largest = np.maximum(np.linalg.eigvalsh(own.gram)[:, -1], 0.0)
        size = np.sqrt(np.mean(largest))
        if size > ROUNDING and np.sum(largest > ROUNDING * size**2) > 1:
            taus = np.array(TAUS_TRIED) / size
            at = own.marginal(range(len(signal.columns)), taus[:, None, None, None]).total
            logs = np.stack([at.log_evidence, at.log_evidence + gain(*explained(at.gram, at.towards))], axis=1).ravel()
            best = int(np.argmax(logs))
            odds = float(np.logaddexp.reduce(logs) - np.log(len(logs)) + np.log(weights[signal.of_head]))
            effect = RandomEffect(signal, float(taus[best // 2]), best % 2 == 1, odds - float(logs[best]))
            scored.append((odds, effect))
    return sorted(scored, key=lambda pair: -pair[0])[:most]
