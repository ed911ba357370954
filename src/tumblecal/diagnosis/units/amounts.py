"""The amount of one effect in every unit, given all other errors: mean, two levels in the order of the units; and whether the
errors of the pitch settings are the head's.

About a mean the amounts scatter with a standard deviation tau, the most likely one (residual likelihood); the mean weighs each
unit by (G^-1 + tau^2)^-1. Two levels, the best of all splits by Cochran's Q, are tested against this scatter by their
likelihood ratio; its null distribution is drawn from the scatter, with the best split searched in every draw.
"""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.priors import LEVELS_FIT, LEVELS_SIZE, PITCH_COMMON, PITCH_SEPARATED, SHOWN_ALONE
from tumblecal.diagnosis.units.hypotheses import determined
from tumblecal.diagnosis.units.mixed_model import NormalEquations, chi2_p_value, explained, rounding_of
from tumblecal.diagnosis.units.search import SharedExplanation
from tumblecal.diagnosis.units.unit import Batch, SharedSignal


# Standard deviations tried, in the noise of one unit's coefficients, and none.
_TAUS = np.concatenate([[0.0], np.geomspace(0.1, 1e4, 60)])
# A coefficient of whose direction the data determine this share of the square is determined by itself.
_DETERMINED = 0.99
# Of one unit alone nobody knows that the next ones would be like it.
_LEAST_UNITS = 2
_DRAWS = 1000


class UnitAmounts(NamedTuple):
    """Information of every unit on one effect.

    - `equations`: of every unit, for the combinations of scaled coefficients that the units determine: the columns of `axes`;
      `determined`: the coefficients that they determine by themselves.
    - `shown_in`: numbers of the units that show it clearly, each by itself.
    - `tau`: the standard deviation between units about their mean, scaled coefficients: the most likely one.
    - `mean`: of these units and its sd by their noise, scaled, without combinations that no unit determines.
    """

    signal: SharedSignal
    equations: NormalEquations
    axes: Float[np.ndarray, "coefficients determined"]
    determined: Bool[np.ndarray, " coefficients"]
    shown_in: tuple[int, ...]
    tau: float
    mean: tuple[Float[np.ndarray, " coefficients"], Float[np.ndarray, " coefficients"]]


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
    own = equations.of(signal.columns)
    axes, _ = determined(own.total.gram)
    own = own.along(axes)
    gram, towards, _ = own
    p_values = chi2_p_value(*explained(gram, towards, rounding_of(gram)))
    shown_in = tuple(np.flatnonzero(p_values < SHOWN_ALONE / len(p_values)).tolist())
    tau, _ = most_likely_spread(own)
    about = own.marginal(range(axes.shape[1]), tau).total
    weights, covariance = np.linalg.inv(np.eye(axes.shape[1]) + tau**2 * gram), np.linalg.inv(about.gram)
    noise = covariance @ np.sum(weights @ gram @ weights.mT, axis=0) @ covariance
    mean = axes @ covariance @ about.towards, _sd(axes, noise)
    return UnitAmounts(signal, own, axes, np.sum(axes**2, axis=1) > _DETERMINED, shown_in, tau, mean)


def _sd(axes: Float[np.ndarray, "coefficients k"], covariance: Float[np.ndarray, "k k"]) -> np.ndarray:
    return np.sqrt(np.vecdot(axes @ covariance, axes))


def most_likely_spread(equations: NormalEquations) -> tuple[float, float]:
    """The most likely standard deviation between the units, and the logarithm of its residual likelihood."""
    largest = np.maximum(np.linalg.eigvalsh(equations.gram)[:, -1], 0.0)
    taus = _TAUS / np.sqrt(max(float(np.mean(largest)), 1e-300))
    about = equations.marginal(range(equations.gram.shape[-1]), taus[:, None, None, None])
    likelihoods = about.total.restricted
    return float(taus[np.argmax(likelihoods)]), float(np.max(likelihoods))


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
    counts = Counter(2 * [*best.by_unit, *best.shared.labels])
    for unit, causes in zip(batch.units, best.hypothesis.unit_causes, strict=True):
        counts.update({unit.pool.labels[k] for k in causes})
    signals = {signal.label: signal for signal in reversed(batch.signals) if signal.of_head and signal.is_effect}
    tried = [signal for label, signal in reversed(signals.items()) if counts[label] > 1]
    for signal in tried:
        found = _split(unit_amounts(batch, best, signal))
        if found is not None and found.p_value * len(tried) < LEVELS_SIZE:
            yield found._replace(p_value=min(1.0, found.p_value * len(tried)))


def _split(amounts: UnitAmounts) -> TwoLevels | None:
    """The best split of the units that show every combination, and its p-value; None where there is no good one."""
    gram = amounts.equations.gram
    chosen = np.flatnonzero(np.min(np.linalg.eigvalsh(gram), axis=1, initial=np.inf) > rounding_of(gram))
    if len(chosen) < 2 * _LEAST_UNITS:
        return None
    equations = amounts.equations.only(chosen)
    ratio, split, within = _likelihood_ratio(equations)
    if chi2_p_value(np.array(within), np.array((len(chosen) - 2) * gram.shape[-1])) < LEVELS_FIT:
        return None
    # Units whose amounts scatter by the most likely standard deviation.
    rng, tau = np.random.default_rng(0), most_likely_spread(equations)[0]
    drawn, noise = (rng.normal(size=(_DRAWS, *equations.towards.shape)) for _ in range(2))
    drawn = tau * np.matvec(equations.gram, drawn) + np.matvec(np.linalg.cholesky(equations.gram), noise)
    null = [_likelihood_ratio(equations._replace(towards=towards))[0] for towards in drawn]
    levels = [equations.only(part).total for part in np.split(np.arange(len(chosen)), [split])]
    return TwoLevels(
        amounts.signal,
        int(chosen[split]),
        np.stack([level.solved() for level in levels]) @ amounts.axes.T,
        np.stack([_sd(amounts.axes, np.linalg.inv(level.gram)) for level in levels]),
        (1 + int(np.sum(np.array(null) >= ratio))) / (1 + len(null)),
    )


def _likelihood_ratio(equations: NormalEquations) -> tuple[float, int, float]:
    """Of the best two levels against a scatter about one mean; the first unit of the second level, and Q within the levels."""
    splits, before = _splits(np.ones(len(equations.gram), bool))
    statistics, _ = equations.heterogeneity(before, ~before)
    within, squares = float(np.min(statistics)), float(np.sum(explained(equations.gram, equations.towards, 0.0)[0]))
    ratio = 0.5 * (squares - within) - most_likely_spread(equations)[1]
    return ratio, int(splits[np.argmin(statistics)]), within


def _splits(counted: Bool[np.ndarray, " units"]) -> tuple[Int[np.ndarray, " splits"], Bool[np.ndarray, "splits units"]]:
    """The first unit of a second level of the units that count, with enough of them in each; and which are before it."""
    splits = np.flatnonzero(counted)[_LEAST_UNITS : np.sum(counted) - _LEAST_UNITS + 1]
    return splits, np.arange(len(counted)) < splits[:, None]


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
    kept, changed = counted.copy(), None
    (statistic,), (dof,) = equations.heterogeneity(kept[None])
    everybody = statistic, dof
    while chi2_p_value(statistic, dof) <= PITCH_COMMON and np.sum(counted & ~kept) < most_alone:
        candidates = np.flatnonzero(kept)
        statistics, dofs = equations.heterogeneity(kept & (np.arange(len(kept)) != candidates[:, None]))
        farthest = np.argmin(statistics)
        if not _improved(statistic - statistics, dof - dofs)[farthest]:
            break
        kept[candidates[farthest]] = False
        statistic, dof = statistics[farthest], dofs[farthest]
    if chi2_p_value(statistic, dof) <= PITCH_COMMON:
        kept, (statistic, dof) = counted, everybody
        splits, before = _splits(counted)
        statistics, dofs = equations.heterogeneity(counted & before, counted & ~before)
        agree = (chi2_p_value(statistics, dofs) > PITCH_COMMON) & _improved(statistic - statistics, dof - dofs)
        changed = int(splits[np.argmin(np.where(agree, statistics, np.inf))]) if np.any(agree) else None
    seen = np.any(np.diagonal(equations.gram[kept], axis1=1, axis2=2) > 0, axis=0)
    p_value = float(chi2_p_value(statistic, dof)) if dof else None
    return PitchSettings(p_value, tuple(np.flatnonzero(counted & ~kept).tolist()), seen, changed)


def _improved(decrease: Float[np.ndarray, " tried"], dof: Int[np.ndarray, " tried"]) -> Bool[np.ndarray, " tried"]:
    """Whether decreases of Q, of which the largest counts, are significant."""
    return len(dof) * chi2_p_value(decrease, dof) < PITCH_SEPARATED
