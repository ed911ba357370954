"""Causes and noise together: where another noise model, with its causes, explains the data better, the problem gets it.

The screen weighs sets of causes under the noise as assumed, and noise models without any cause. Here both vary (`noise_table`).
"""

from dataclasses import replace
from math import prod
from typing import NamedTuple

import numpy as np

from tumblecal.diagnosis.causes.cause import UNEXPLAINED
from tumblecal.diagnosis.noise.alternatives import NoiseAlternatives
from tumblecal.diagnosis.noise.fit import corrected
from tumblecal.diagnosis.noise.models import LEVEL, NOISIER, NoiseModel
from tumblecal.diagnosis.priors import (
    LEAST_NOISE_ODDS,
    MOST_NOISE_CORRECTIONS,
    MOST_SETS_WITH_NOISE,
    MOST_UNEQUAL,
    SEVERAL_CAUSES,
    SURE_LEVEL,
)
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.noise_table import (
    ASSUMED,
    NoiseChange,
    NoiseTable,
    many_outliers,
    without_outliers,
)
from tumblecal.diagnosis.screening.screen import Screening
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import sets_of
from tumblecal.diagnosis.sets.patchwork import is_patchwork
from tumblecal.diagnosis.sets.prior import SetPriors, given_found
from tumblecal.diagnosis.sets.search import Search
from tumblecal.estimation.mean_noise import MeanNoise
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.priors import SIZE_PRIOR
from tumblecal.full_model.tangent import Tangent
from tumblecal.noise.covariance import Covariance


_OUTLIERS = "outlier_position"
_ALTERNATIVE_WORDS = {
    UNEXPLAINED: "an effect that is not in the catalogue",
    _OUTLIERS: "a few outlier positions",
    ASSUMED: "the noise as assumed",
}


class NoiseFault(NamedTuple):
    """The fault of the noise, its probability and the alternative as in `NoiseChange`."""

    measured: str
    alternative: str
    probability: float = 1.0

    @property
    def doubtful(self) -> bool:
        """Whether the alternative is not another fault of the noise."""
        return self.alternative in _ALTERNATIVE_WORDS

    @property
    def words(self) -> str:
        """Both in words."""
        alternative = _ALTERNATIVE_WORDS.get(self.alternative, self.alternative)
        return f"{self.measured} ({alternative} would explain it about as well)" if alternative else self.measured

    def with_earlier(self, earlier: "NoiseFault | None") -> "NoiseFault":
        """Both, if the noise of this label was corrected before."""
        if earlier is None:
            return self
        measured = "; ".join(filter(None, [earlier.measured, self.measured]))
        return NoiseFault(measured, self.alternative or earlier.alternative, self.probability * earlier.probability)


def screen_with_noise(
    screening: Screening, problem: Problem, screened: Screened | None = None
) -> tuple[Screened, dict[str, NoiseFault], float]:
    """Screen. If the noise model is wrong, correct it and screen again. `screened`: an existing screen of this problem.

    **Returns:** the screen, the faults of the noise by label, and the first p-value.
    """
    change = None
    if screened is None:
        screened = screening.first(problem)
        change = _sure_level(screening, screened)
        screened = screened if change else screening(problem, screened)
    p_value, faults, used = screened.detection.p_value, dict[str, NoiseFault](), list[tuple[str, bool]]()
    for _ in range(MOST_NOISE_CORRECTIONS):
        # Once the level is corrected, unequal axes may still show.
        tried = tuple(label for label, known in used if known == screened.problem.known)
        change = change or noise_change(screened, tried)
        if change is None:
            break
        base, label = screened.search.base(change.members), change.model.label
        used.append((label, screened.problem.known))
        of_noise, measured = corrected(screened.at, base.z, base.q, change.model)
        fault = NoiseFault(measured, change.alternative, change.probability)
        faults[label] = fault.with_earlier(faults.get(label))
        screened = replace(screening, corrected=True, found=screening.found + len(faults))(of_noise)
        change = None
    if faults and (plain := _without_correction(screening, problem, screened)) is not None:
        screened, faults = plain, {}
    if faults and _without_name(screened, problem, len(faults)):
        faults = {label: fault._replace(alternative=UNEXPLAINED) for label, fault in faults.items()}
    # A statement about causes includes the noise that it assumes.
    probability = prod(fault.probability for fault in faults.values())
    explanations = [own.times(probability) for own in screened.explanations] if faults else screened.explanations
    return replace(screened, explanations=explanations), faults, p_value


def _sure_level(screening: Screening, first: Screened) -> NoiseChange | None:
    """A different level of the noise, if it is far ahead of several causes in the first screen: each of these would be
    refined, and no refinement could come near it."""
    if screening.noise_stands or not first.detection.detected or len(first.best.members) < SEVERAL_CAUSES:
        return None
    change = _free_level(first)
    least = SURE_LEVEL + max(0.0, _log_odds_of_unexplained(first))
    return change if change is not None and change.log_odds >= least else None


def _without_name(screened: Screened, assumed: Problem, noises: int) -> bool:
    """Whether the fault of the noise may be a part of something without a name: that leads under the noise corrected,
    or patchwork leads with it, or one axis would be noisier than others ever are."""
    leading, best = screened.explanations[0], screened.best
    by_axis = np.median(screened.problem.sd / assumed.sd, axis=0)
    uneven = np.max(by_axis) > MOST_UNEQUAL * np.min(by_axis)
    return leading.unexplained or is_patchwork(best.labels, noises) or bool(uneven)


def _without_correction(screening: Screening, problem: Problem, corrected: Screened) -> Screened | None:
    """The screen under the noise as assumed, around the effects found under another, if that noise is not needed there.

    The nominal fit's linearisation leaves of large effects a residual that may look like another noise.
    """
    members = corrected.members
    if not any(cause.slot.columns for cause in members):
        return None
    fit = corrected.fit or fit_with(corrected.at, members)
    plain = screening.around(fit.vector, problem, corrected.pool, likely=members)
    same = plain.detection.detected and plain.best.labels == corrected.best.labels
    return plain if same and noise_change(plain) is None else None


def noise_change(screened: Screened, used: tuple[str, ...] = ()) -> NoiseChange | None:
    """The best noise alternative, given the best causes, if the data favour it; otherwise None.

    **Arguments:**

    - `screened`: the screen under the noise as assumed. `used`: labels of the noise alternatives already applied.
    """
    if not screened.detection.detected:
        return None
    noise = screened.alternatives.noise.without(used)
    table = NoiseTable.of(screened, noise)
    if many_outliers(screened) and not np.all(noise.is_gaussian):
        change = table.best(lambda model: model.tail is not None or model.kind in NOISIER)
    else:
        change = _decided(screened, table)
    # Errors of the attitude that repeats show are no noise.
    if change is None or change.model.label == UNEXPLAINED:
        return None
    if change.model.tail is not None and screened.problem.known:
        # Under a stated sd that is too small anything has heavy tails.
        return _free_level(screened) or change
    return change


def _decided(screened: Screened, table: NoiseTable) -> NoiseChange | None:
    """The best noise of a table, if it is more probable than the best causes and than lack of fit; it has an alternative if
    the difference is small."""
    best, unexplained, leading = table.best(), _log_odds_of_unexplained(screened), screened.best.noise
    if best is None or best.model.label == UNEXPLAINED:
        return None
    # A wrong level is simpler than an effect that is not in the catalogue.
    simpler = LEAST_NOISE_ODDS if best.model.kind == LEVEL else 0.0
    if best.log_odds < unexplained - simpler and not leading:
        return None
    best = _level_first(table, best)
    if best.log_odds < 0.0:
        # All kinds of a label together may lead although no single one does.
        best = table.best(lambda model: model.label == leading)
    if best is None:
        return None
    if best.log_odds < unexplained + LEAST_NOISE_ODDS:
        return replace(best, alternative=UNEXPLAINED)
    if best.log_odds < LEAST_NOISE_ODDS and best.model.kind in NOISIER and _only_outliers(screened):
        return replace(best, alternative=_OUTLIERS)
    return best


def _level_first(table: NoiseTable, best: NoiseChange) -> NoiseChange:
    """The level, if these data cannot distinguish it from another kind of noise: it is simpler. Unequal standard deviations
    contain a part of a wrong level, so their odds decide."""
    level = table.best(lambda model: model.kind == LEVEL)
    other = table.best(lambda model: model.kind != LEVEL)
    if level is None or other is None or other.model.label == "noise_unequal":
        return best
    near = abs(other.log_odds - level.log_odds) <= LEAST_NOISE_ODDS
    return replace(level, alternative=other.model.label) if near else best


def _only_outliers(screened: Screened) -> bool:
    """Whether the best causes under the noise as assumed are outlier positions, and nothing else: a part of the data with
    several of them looks noisier."""
    members = screened.search.ranked().set_at(0)
    return bool(members) and not without_outliers(screened.search, members)


def _log_odds_of_unexplained(screened: Screened) -> float:
    """Log odds of lack of fit that no entry describes against the best set of causes."""
    return screened.alternatives.lack_of_fit + float(np.log(SIZE_PRIOR[1])) - screened.search.top


def _free_level(screened: Screened) -> NoiseChange | None:
    """A different level of a stated noise, with the most probable causes for it: these are searched again, because if the
    stated level is too small, all data look like many causes. None if heavy tails with a free level are more probable, or
    nearly so for sets with outlier positions, which tails would replace."""
    noise, search = screened.alternatives.noise, Search(screened.pool, screened.at.z, known=False)
    level = next((model for model in noise.listed if model.kind == LEVEL), None)
    if level is None:
        return None
    ranked = search.run()
    best, sets = ranked.set_at(0), sets_of(ranked.members[:MOST_SETS_WITH_NOISE])
    plain = list(dict.fromkeys([(), *(without_outliers(search, own) for own in sets)]))
    tails = NoiseAlternatives(screened.at, tuple(model for model in noise.listed if model.tail is not None))
    tail = NoiseTable.among(search, plain, tails).best()
    outliers = any(screened.pool.causes[k].left_out for k in best)
    if tail is not None and (outliers or tail.log_odds > level.log_weight):
        return None
    causes = SetPriors.of(screened.pool, ranked.members[:1]).causes
    odds = float(ranked.log_posterior[0] + given_found(causes, 1)[0]) + level.log_weight - screened.search.top
    return NoiseChange(level, best, odds, float(np.exp(-np.logaddexp(0.0, -odds))))


def chosen_mean_noise(at: Tangent, noises: list[MeanNoise], screening: Screening) -> tuple[MeanNoise, Screened | None]:
    """The noise of a recording that goes best with the scatter of the positions, causes allowed.

    **Arguments:**

    - `at`: the problem under the first candidate, around its nominal fit.

    **Returns:** the candidate, and the screen of the problem under it where that was made.
    """
    # The first, or the smaller white noise of the samples alone, if that agrees best with the residuals without any cause.
    alternatives = NoiseAlternatives(at, tuple(_as_model(noise, at) for noise in noises[1:]))
    evidence = alternatives.log_evidence(at.z[None], known=True)[0]
    likeliest = noises[1 + int(np.argmax(evidence))]
    smaller = likeliest.lasts == "white" and np.max(evidence) > noises[0].log_weight - 0.5 * at.z @ at.z
    chosen, screened = likeliest if smaller else noises[0], None
    for _ in noises:
        # The levels separate them too: all of them count as known here.
        problem = chosen.applied(at.problem, known=True)
        screened = screening(problem)
        others = [(noise, _as_model(noise, screened.at)) for noise in noises if noise is not chosen]
        # Scatter that no samples show (a head that repeats less well) is no reason to take their noise for slow.
        listed = (*(model for _, model in others), *screened.alternatives.noise.listed)
        best = NoiseTable.of(screened, NoiseAlternatives(screened.at, listed)).best()
        better = best.model if best is not None and best.log_odds >= chosen.log_weight else None
        other = next((noise for noise, model in others if model is better), None)
        if other is None:
            break
        chosen, screened = other, None
    return chosen, None if chosen.extrapolated else screened


def _as_model(noise: MeanNoise, at: Tangent) -> NoiseModel:
    """A recording's noise as an alternative to that of a problem, whose axes are independent."""
    whitening = np.asarray(at.problem.whitening)
    if whitening.ndim == 1:
        by_axis = whitening.reshape(-1, 3).T
        relative = noise.covariance * by_axis[:, :, None] * by_axis[:, None, :]
    else:
        relative = whitening @ noise.covariance @ whitening.swapaxes(1, 2)
    return NoiseModel(noise.label, noise.label, noise.log_weight, Covariance.by_axis(relative), recorded=True)
