"""The amount of one effect in every unit, given all other errors: mean, two levels in the order of the units; and whether the
errors of the pitch settings are the head's.

About a mean the amounts scatter with a standard deviation tau, the most likely one (residual likelihood); the mean weighs each
unit by (G^-1 + tau^2)^-1. Two levels, the best of all splits, are tested against this scatter by their likelihood ratio; its
null distribution is drawn from the scatter, with the best split searched in every draw.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.priors import LEVELS_FIT, LEVELS_SIZE, PITCH_COMMON, PITCH_SEPARATED, SHOWN_ALONE
from tumblecal.diagnosis.units.batch import Batch, SharedSignal
from tumblecal.diagnosis.units.hypotheses import determined
from tumblecal.diagnosis.units.mixed_model import NormalEquations, chi2_p_value, explained, profiles, rounding_of
from tumblecal.diagnosis.units.search import SharedExplanation


# Standard deviations tried, in the noise of one unit's coefficients, and none.
_TAUS = np.concatenate([[0.0], np.geomspace(0.1, 1e4, 60)])
# A coefficient of whose direction the data determine this share of the square is determined by itself.
_DETERMINED = 0.99
# Of one unit alone nobody knows that the next ones would be like it.
LEAST_UNITS = 2
_DRAWS = 1000


@dataclass(frozen=True)
class UnitAmounts:
    """Information of every unit on one effect.

    - `equations`: of every unit, for the combinations of scaled coefficients that the units determine: the columns of `axes`.
    """

    signal: SharedSignal
    equations: NormalEquations
    axes: Float[np.ndarray, "coefficients determined"]

    @cached_property
    def _floor(self) -> float:
        return rounding_of(self.equations.gram)

    @cached_property
    def shown_by(self) -> Bool[np.ndarray, " units"]:
        """Which units show every determined combination."""
        return np.min(np.linalg.eigvalsh(self.equations.gram), axis=1, initial=np.inf) > self._floor

    @cached_property
    def determined(self) -> Bool[np.ndarray, " coefficients"]:
        """Which coefficients the units determine by themselves."""
        return np.sum(self.axes**2, axis=1) > _DETERMINED

    @cached_property
    def shown_in(self) -> tuple[int, ...]:
        """Numbers of the units that show it clearly, each by itself."""
        p_values = chi2_p_value(*explained(self.equations.gram, self.equations.towards, self._floor))
        return tuple(np.flatnonzero(p_values < SHOWN_ALONE / len(p_values)).tolist())

    @cached_property
    def tau(self) -> float:
        """The standard deviation between units about their mean, scaled coefficients: the most likely one."""
        likelihoods, taus = restricted_likelihoods(self.equations.gram, self.equations.towards[None])
        return float(taus[np.argmax(likelihoods[:, 0])])

    @cached_property
    def mean(self) -> tuple[Float[np.ndarray, " coefficients"], Float[np.ndarray, " coefficients"]]:
        """The mean of these units and its sd by their noise, scaled, without combinations that no unit determines."""
        gram, towards, _ = self.equations
        weights = np.linalg.inv(np.eye(gram.shape[-1]) + self.tau**2 * gram)
        covariance = np.linalg.inv(np.sum(weights @ gram, axis=0))
        mean = covariance @ np.sum(np.matvec(weights, towards), axis=0)
        noise = covariance @ np.sum(weights @ gram @ weights.mT, axis=0) @ covariance
        return self.axes @ mean, _sd(self.axes, noise)


def _sd(axes: Float[np.ndarray, "coefficients k"], covariance: Float[np.ndarray, "k k"]) -> np.ndarray:
    return np.sqrt(np.vecdot(axes @ covariance, axes))


def unit_amounts(batch: Batch, best: SharedExplanation, signal: SharedSignal) -> UnitAmounts:
    """Amount of an effect in every unit of the batch, excluded ones included, given the other errors of an explanation."""
    others, hypothesis = best.coefficients, best.hypothesis
    others[list(signal.columns)] = 0.0
    pairs = zip(batch.units, hypothesis.unit_causes, strict=True)
    causes = [unit.only(own, lambda cause: cause.slot.id != signal.slot.id) for unit, own in pairs]
    equations = batch.equations(causes).given(others)
    for effect in hypothesis.random_effects:
        if effect.signal.label != signal.label:
            equations = equations.marginal(*effect.law)
    gram, towards, log_evidence = equations.of(signal.columns)
    axes, _ = determined(np.sum(gram, axis=0))
    return UnitAmounts(signal, NormalEquations(axes.T @ gram @ axes, towards @ axes, log_evidence), axes)


def restricted_likelihoods(
    gram: Float[np.ndarray, "units k k"], towards: Float[np.ndarray, "draws units k"]
) -> tuple[Float[np.ndarray, "taus draws"], Float[np.ndarray, " taus"]]:
    """Residual log likelihood of each standard deviation between the units, for each set of data."""
    largest = np.maximum(np.linalg.eigvalsh(gram)[:, -1], 0.0)
    taus = _TAUS / np.sqrt(max(float(np.mean(largest)), 1e-300))
    return np.stack([at.restricted for at in profiles(gram, towards, taus)]), taus


class TwoLevels(NamedTuple):
    """An error of the head that differs from some unit on.

    - `first`: number of the first unit of the second level. `values`, `sd` (2, coefficients): of each level, scaled.
    - `p_value`: of so clear a split in units that scatter in any order, all errors tried counted.
    """

    signal: SharedSignal
    first: int
    values: Float[np.ndarray, "2 coefficients"]
    sd: Float[np.ndarray, "2 coefficients"]
    p_value: float


def two_levels(batch: Batch, best: SharedExplanation) -> Iterator[TwoLevels]:
    """The errors of the head (shared, random, or of some units) that have two levels."""
    tried = list(_candidates(batch, best))
    for signal in tried:
        found = _split(unit_amounts(batch, best, signal))
        if found is not None and found.p_value * len(tried) < LEVELS_SIZE:
            yield found._replace(p_value=min(1.0, found.p_value * len(tried)))


def _candidates(batch: Batch, best: SharedExplanation) -> Iterator[SharedSignal]:
    pairs = zip(batch.units, best.hypothesis.unit_causes, strict=True)
    in_units = Counter(label for unit, causes in pairs for label in {unit.pool.labels[k] for k in causes.members})
    common = {*best.by_unit, *(signal.label for signal in best.signals)}
    signals = [*best.hypothesis.signals, *(effect.signal for effect in best.hypothesis.random_effects)]
    for label, signal in reversed({signal.label: signal for signal in reversed(signals)}.items()):
        if signal.is_effect and signal.of_head and (label in common or in_units[label] > 1):
            yield signal


def _split(amounts: UnitAmounts) -> TwoLevels | None:
    """The best split and its p-value; None where there is no good one."""
    axes, chosen = amounts.axes, np.flatnonzero(amounts.shown_by)
    if len(chosen) < 2 * LEAST_UNITS:
        return None
    gram, towards, _ = amounts.equations.only(chosen)
    squares = _squares_of_levels(gram, towards[None])[0]
    split = int(np.argmax(squares)) + LEAST_UNITS
    within = float(np.sum(explained(gram, towards, 0.0)[0])) - float(np.max(squares))
    if chi2_p_value(np.array(within), np.array((len(chosen) - 2) * gram.shape[-1])) < LEVELS_FIT:
        return None
    likelihoods, taus = restricted_likelihoods(gram, towards[None])
    observed = 0.5 * float(np.max(squares)) - float(np.max(likelihoods))
    drawn = _drawn(gram, float(taus[np.argmax(likelihoods)]))
    null = 0.5 * np.max(_squares_of_levels(gram, drawn), axis=1) - np.max(
        restricted_likelihoods(gram, drawn)[0], axis=0
    )
    covariances = [np.linalg.inv(np.sum(part, axis=0)) for part in np.split(gram, [split])]
    levels = [
        inverse @ np.sum(part, axis=0) for inverse, part in zip(covariances, np.split(towards, [split]), strict=True)
    ]
    return TwoLevels(
        amounts.signal,
        int(chosen[split]),
        np.stack(levels) @ axes.T,
        np.stack([_sd(axes, covariance) for covariance in covariances]),
        (1 + int(np.sum(null >= observed))) / (1 + len(null)),
    )


def _squares_of_levels(
    gram: Float[np.ndarray, "units k k"], towards: Float[np.ndarray, "draws units k"]
) -> Float[np.ndarray, "draws splits"]:
    """Sum of squares that two levels explain, by the split."""
    inner = slice(LEAST_UNITS - 1, len(gram) - LEAST_UNITS)
    before, sums, total = np.cumsum(gram, axis=0), np.cumsum(towards, axis=1), 0.0
    after = before[-1] - before[inner], sums[:, -1:] - sums[:, inner]
    for part, along in ((before[inner], sums[:, inner]), after):
        total = total + np.vecdot(along, np.matvec(np.linalg.inv(part), along))
    return np.asarray(total)


def _drawn(gram: Float[np.ndarray, "units k k"], tau: float) -> Float[np.ndarray, "draws units k"]:
    """Normal equations of units whose amounts scatter by a standard deviation."""
    rng = np.random.default_rng(0)
    amounts, noise = (rng.normal(size=(_DRAWS, *gram.shape[:2])) for _ in range(2))
    return tau * np.matvec(gram, amounts) + np.matvec(np.linalg.cholesky(gram), noise)


class PitchSettings(NamedTuple):
    """Errors of the pitch settings by all units together.

    - `p_value`: probability of so much dispersion by noise alone; None if there is nothing to compare.
    - `alone`: numbers of the units excluded from that, because only theirs differ.
    - `seen`: the settings at which the rest were measured.
    - `changed`: number of the first unit from which on they are different (and equal again), if they are not equal in all.
    """

    p_value: float | None
    alone: tuple[int, ...]
    seen: Bool[np.ndarray, " settings"]
    changed: int | None = None

    @property
    def common(self) -> bool:
        """Whether they are the head's."""
        return self.p_value is not None and self.p_value > PITCH_COMMON


def pitch_settings(equations: NormalEquations, counted: Bool[np.ndarray, " units"], most_alone: int) -> PitchSettings:
    """Compare the pitch errors of the units that count, given the shared errors, by Cochran's Q.

    If they differ by more than the noise, those farthest from the others are excluded one by one, as long as the rest may then
    agree: one wrong label does not mean an axis that is set again for each unit. Otherwise they may have changed once.

    **Arguments:**

    - `equations` (units, settings): of the pitch errors; a setting that a unit lacks has no information.
    - `most_alone`: how many units may be excluded.
    """
    numbers, kept, changed = np.arange(len(counted)), counted.copy(), None
    (statistic,), (dof,) = equations.heterogeneity(kept[None])
    everybody = statistic, dof
    while chi2_p_value(statistic, dof) <= PITCH_COMMON and np.sum(counted & ~kept) < most_alone:
        candidates = np.flatnonzero(kept)
        statistics, dofs = equations.heterogeneity(kept & (numbers != candidates[:, None]))
        farthest = np.argmin(statistics)
        if not _improved(statistic - statistics, dof - dofs)[farthest]:
            break
        kept[candidates[farthest]] = False
        statistic, dof = statistics[farthest], dofs[farthest]
    if chi2_p_value(statistic, dof) <= PITCH_COMMON:
        kept, (statistic, dof) = counted, everybody
        splits = np.flatnonzero(counted)[LEAST_UNITS : np.sum(counted) - LEAST_UNITS + 1]
        before = numbers < splits[:, None]
        statistics, dofs = equations.heterogeneity(counted & before, counted & ~before)
        agree = (chi2_p_value(statistics, dofs) > PITCH_COMMON) & _improved(statistic - statistics, dof - dofs)
        changed = int(splits[np.argmin(np.where(agree, statistics, np.inf))]) if np.any(agree) else None
    seen = np.any(np.diagonal(equations.gram[kept], axis1=1, axis2=2) > 0, axis=0)
    p_value = float(chi2_p_value(statistic, dof)) if dof else None
    return PitchSettings(p_value, tuple(np.flatnonzero(counted & ~kept).tolist()), seen, changed)


def _improved(decrease: Float[np.ndarray, " tried"], dof: Int[np.ndarray, " tried"]) -> Bool[np.ndarray, " tried"]:
    """Whether decreases of Q, of which the largest counts, are significant."""
    return len(dof) * chi2_p_value(decrease, dof) < PITCH_SEPARATED
