"""Causes and noise together: where another noise model, with its causes, explains the data better, the problem gets it.

The screen weighs sets of causes under the noise as assumed, and noise models without any cause. Here both vary.
"""

from collections.abc import Callable
from dataclasses import replace
from math import prod
from typing import NamedTuple

import numpy as np

from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.diagnosis.noise.alternatives import NoiseAlternatives
from tumblecal.diagnosis.noise.fit import corrected
from tumblecal.diagnosis.noise.models import LEVEL, NOISIER, NoiseModel
from tumblecal.diagnosis.priors import LEAST_NOISE_ODDS, MOST_UNEQUAL, SIZE_PRIOR
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.level import SURE_LEVEL, level_change
from tumblecal.diagnosis.screening.noise_scores import (
    ASSUMED,
    NoiseChange,
    NoiseScores,
    many_outliers,
    without_outliers,
)
from tumblecal.diagnosis.screening.screen import Screening
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.patchwork import is_patchwork
from tumblecal.estimation.mean_noise import MeanNoise
from tumblecal.estimation.problem import Problem
from tumblecal.noise.covariance import Covariance


_MOST_REWEIGHTINGS = 3
# So many causes or more under a stated level may all stand for another level.
_SEVERAL = 3
_OUTLIERS = "outlier_position"
_RIVAL_WORDS = {
    UNEXPLAINED: "an effect that is not in the catalogue",
    _OUTLIERS: "a few outlier positions",
    ASSUMED: "the noise as assumed",
}


class NoiseFault(NamedTuple):
    """The fault of the noise, its probability and the alternative as in `NoiseChange`."""

    measured: str
    rival: str
    probability: float = 1.0

    @property
    def doubtful(self) -> bool:
        """Whether the alternative is not another fault of the noise."""
        return self.rival in _RIVAL_WORDS

    @property
    def words(self) -> str:
        """Both in words."""
        rival = _RIVAL_WORDS.get(self.rival, self.rival)
        return f"{self.measured} ({rival} would explain it about as well)" if rival else self.measured


def screen_with_noise(
    screening: Screening, problem: Problem, screened: Screened | None = None
) -> tuple[Screened, dict[str, NoiseFault], float]:
    """Screen. If the noise model is wrong, correct it and screen again. `screened`: an existing screen of this problem.

    **Returns:** the screen, the faults of the noise by label, and the first p-value.
    """
    assumed, level = problem, None
    if screened is None:
        screened = screening.first(problem)
        level = _sure_level(screening, screened)
        screened = screened if level else screening(problem, screened)
    wrong, assumed_p = dict[str, NoiseFault](), screened.detection.p_value
    used: list[tuple[str, bool]] = []
    for _ in range(_MOST_REWEIGHTINGS):
        # Once the level is corrected, unequal axes may still show.
        tried = tuple(label for label, known in used if known == screened.problem.known)
        change = level or (noise_change(screened, tried) if screened.detection.detected else None)
        level = None
        if change is None:
            break
        base, label = screened.search.base(change.members), change.model.label
        used.append((label, screened.problem.known))
        problem, said = corrected(screened.at, base.z, base.q, change.model)
        before = wrong.get(label, NoiseFault("", ""))
        wrong[label] = NoiseFault(
            "; ".join(filter(None, [before.measured, said])),
            change.rival or before.rival,
            change.probability * before.probability,
        )
        screened = replace(screening, corrected=True, found=screening.found + len(wrong))(problem)
    plain = _without_correction(screening, assumed, screened) if wrong else None
    if plain is not None:
        return plain, {}, assumed_p
    if wrong and _without_name(screened, assumed, len(wrong)):
        wrong = {label: fault._replace(rival=UNEXPLAINED) for label, fault in wrong.items()}
    # A statement about causes includes the noise that it assumes.
    probability = prod(fault.probability for fault in wrong.values())
    return replace(screened, explanations=[own.times(probability) for own in screened.explanations]), wrong, assumed_p


def _sure_level(screening: Screening, first: Screened) -> NoiseChange | None:
    """Another level of the noise, where nothing that is refined under the stated one could come near it: many causes stand for
    it there, and each would be refined."""
    if not first.problem.known or screening.noise_stands or not first.detection.detected:
        return None
    change = level_change(first) if len(first.best.members) >= _SEVERAL else None
    if change is None or change.log_odds < SURE_LEVEL + max(0.0, _unexplained_log_odds(first)):
        return None
    return change


def _without_name(screened: Screened, assumed: Problem, noises: int) -> bool:
    """Whether what looks like another noise may be a part of something without a name: that leads under the noise corrected,
    or what leads there is patchwork with it, or one axis would be noisier than others ever are."""
    leading, best = screened.explanations[0], screened.best
    by_axis = np.median(screened.problem.sd / assumed.sd, axis=0)
    uneven = np.max(by_axis) > MOST_UNEQUAL * np.min(by_axis)
    return leading.unexplained or is_patchwork(best.labels, noises) or bool(uneven)


def _without_correction(screening: Screening, problem: Problem, corrected: Screened) -> Screened | None:
    """The screen under the noise as assumed, around the effects found under another, where that noise is not needed there.

    Of large effects the nominal fit's linearisation leaves what may look like another noise.
    """
    members = corrected.members
    if not any(cause.slot.columns for cause in members):
        return None
    fit = corrected.fit or fit_with(corrected.at, members)
    plain = screening.around(fit.vector, problem, corrected.pool.visible, likely=members)
    needed = not plain.detection.detected or plain.best.labels != corrected.best.labels
    return None if needed or noise_change(plain, ()) is not None else plain


def chosen_mean_noise(
    at: Tangent, noises: list[MeanNoise], screening_of: Callable[[Problem], Screening]
) -> tuple[MeanNoise, Screened | None]:
    """The candidate that goes best with the scatter of the positions, causes allowed.

    **Arguments:**

    - `at`: the problem under the first candidate, around its nominal fit.

    **Returns:** the candidate, and the screen of the problem under it where that was made.
    """
    problem, chosen, screened = at.problem, _first_tried(at, noises), None
    for _ in noises:
        # The levels separate them too: all of them count as known here.
        under_chosen = chosen.applied(problem, known=True)
        screened = screening_of(under_chosen)(under_chosen)
        listed = [_as_model(noise, screened.at) for noise in noises if noise is not chosen]
        # Scatter that no samples show (a head that repeats less well) is no reason to take their noise for slow.
        tried = NoiseAlternatives(screened.at, (*listed, *screened.alternatives.noise.listed))
        best = NoiseScores.of(screened, tried).most_probable()
        if best is None or best.log_odds < chosen.log_weight:
            break
        if not any(best.model is model for model in listed):
            break
        chosen, screened = next(noise for noise in noises if noise.label == best.model.label), None
    return chosen, None if chosen.extrapolated else screened


def _first_tried(at: Tangent, noises: list[MeanNoise]) -> MeanNoise:
    """The first, or the smaller white noise of the samples alone, if that agrees best with the residuals without any cause."""
    rivals = NoiseAlternatives(at, tuple(_as_model(noise, at) for noise in noises[1:]))
    evidence = rivals.log_evidence(at.z[None], known=True)[0]
    best = noises[1 + int(np.argmax(evidence))]
    return best if best.lasts == "white" and np.max(evidence) > noises[0].log_weight - 0.5 * at.z @ at.z else noises[0]


def _as_model(noise: MeanNoise, at: Tangent) -> NoiseModel:
    """A recording's noise as an alternative to that of a problem, whose axes are independent."""
    whitening = np.asarray(at.problem.whitening)
    if whitening.ndim == 1:
        by_axis = whitening.reshape(-1, 3).T
        relative = noise.covariance * by_axis[:, :, None] * by_axis[:, None, :]
    else:
        relative = whitening @ noise.covariance @ whitening.swapaxes(1, 2)
    return NoiseModel(noise.label, noise.label, noise.log_weight, Covariance.by_axis(relative), recorded=True)


def noise_change(screened: Screened, used: tuple[str, ...]) -> NoiseChange | None:
    """The best noise alternative, given the best causes, if the data favour it; otherwise None.

    **Arguments:**

    - `screened`: the screen under the noise as assumed, something being detected.
    - `used`: labels of the noise alternatives already applied.
    """
    best = _most_probable(screened, used)
    if best is not None and best.model.label == UNEXPLAINED:
        # The repeats show how large the noise is: what comes back in them is none.
        return None
    if best is None or best.model.tail is None or not screened.problem.known:
        return best
    return level_change(screened) or best


def _most_probable(screened: Screened, used: tuple[str, ...]) -> NoiseChange | None:
    """`noise_change`, tails under the level as stated."""
    tried = screened.alternatives.noise.without(used)
    scores = NoiseScores.of(screened, tried)
    if many_outliers(screened) and not np.all(tried.is_gaussian):
        # Tails stand for the outlier positions, so these are no alternative to them.
        alone = replace(scores, total=-np.inf)
        return alone.most_probable(lambda model: model.tail is not None or model.kind in NOISIER)
    best = scores.most_probable()
    if best is not None and best.model.label == UNEXPLAINED:
        return best
    unexplained = _unexplained_log_odds(screened)
    # A wrong level is simpler than an effect that is not in the catalogue.
    simpler = LEAST_NOISE_ODDS if best is not None and best.model.kind == LEVEL else 0.0
    if best is not None and best.log_odds < unexplained - simpler and not screened.best.noise:
        return None
    best = _level_first(scores, best)
    if best is not None and best.log_odds < 0.0:
        # All kinds of a label together may lead where no single one does.
        leading = screened.best.noise
        best = scores.most_probable(lambda model: model.label == leading)
    if best is not None and best.log_odds < unexplained + LEAST_NOISE_ODDS:
        return replace(best, rival=UNEXPLAINED)
    if (
        best is not None
        and best.model.kind in NOISIER
        and best.log_odds < LEAST_NOISE_ODDS
        and _positions_off(screened)
    ):
        return replace(best, rival=_OUTLIERS)
    return best


def _positions_off(screened: Screened) -> bool:
    """Whether the best causes under the noise as assumed are positions that are off, and nothing else: a part of the data with
    several of them looks noisier."""
    members = screened.search.ranked().set_at(0)
    return bool(members) and not without_outliers(screened.search, members)


def _unexplained_log_odds(screened: Screened) -> float:
    """Log odds of lack of fit that no entry describes against the best set of causes."""
    return screened.alternatives.lack_of_fit + float(np.log(SIZE_PRIOR[1])) - screened.search.top


def _level_first(scores: NoiseScores, best: NoiseChange | None) -> NoiseChange | None:
    """The level, if these data cannot distinguish it from another kind of noise: it is simpler. Unequal standard deviations
    contain a part of a wrong level, so their odds decide."""
    level = scores.most_probable(lambda model: model.kind == LEVEL)
    other = scores.most_probable(lambda model: model.kind != LEVEL)
    if level is None or other is None or best is None or other.model.label == "noise_unequal":
        return best
    if abs(other.log_odds - level.log_odds) > LEAST_NOISE_ODDS:
        return best
    return replace(level, rival=other.model.label)
