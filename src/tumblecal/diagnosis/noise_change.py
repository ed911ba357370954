"""Causes and noise together: where another noise model, with its causes, explains the data better, the problem gets it.

The screen weighs sets of causes under the noise as assumed, and noise models without any cause. Here both vary: for a
set M and a noise alternative N with covariance K on the residual space, `z` and the set's columns are whitened by K and
the evidence is that of the screen, less half the logarithm of K's determinant.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import chain, combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.evidence import LEAST_FREE, log_evidence, log_evidence_of_noise
from tumblecal.diagnosis.generic_causes import UNEXPLAINED
from tumblecal.diagnosis.insert import fit_with
from tumblecal.diagnosis.noise_causes import LEVEL, NoiseAlternative, alternative_of, log_noise_evidence
from tumblecal.diagnosis.noise_fit import corrected
from tumblecal.diagnosis.screen import Screened, Screening
from tumblecal.diagnosis.set_prior import log_prior
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import LEAST_NOISE_ODDS, MANY_OUTLIERS, SIZE_PRIOR
from tumblecal.estimation.mean_noise import MeanNoise
from tumblecal.estimation.problem import Problem
from tumblecal.noise.covariance import Covariance


_MOST_SETS = 8
# A noise model this far (log) behind before the set is fitted anew under it is not tried.
_HOPELESS = 10.0
_MOST_REWEIGHTINGS = 3
_RIVAL_WORDS = {UNEXPLAINED: "something that no entry describes"}


@dataclass(frozen=True)
class NoiseChange:
    """A noise alternative that, with the causes `members` (indices into the pool), is more probable than the best
    set of causes under the noise as assumed; `log_odds` of the two. `rival`: another alternative that these data cannot
    tell from it."""

    alternative: NoiseAlternative
    members: tuple[int, ...]
    log_odds: float
    rival: str = ""


class NoiseFault(NamedTuple):
    """What was wrong with the noise in words, and the rival as in `NoiseChange`."""

    words: str
    rival: str


def screen_with_noise(
    screening: Screening, problem: Problem, screened: Screened | None = None
) -> tuple[Screened, dict[str, NoiseFault], float]:
    """Screen; where the noise model is wrong as well, correct it and screen again; `screened`: of this problem already.

    **Returns:** the screen, what was wrong with the noise by label, first p-value.
    """
    assumed, screened = problem, screened or screening(problem)
    wrong, assumed_p = dict[str, NoiseFault](), screened.detection.p_value
    used: list[tuple[str, bool]] = []
    for _ in range(_MOST_REWEIGHTINGS):
        # Once the level is corrected, unequal axes may still show.
        tried = tuple(label for label, known in used if known == screened.problem.known)
        change = noise_change(screened, tried) if screened.detection.detected else None
        if change is None:
            break
        base, label = screened.search.base(change.members), change.alternative.label
        used.append((label, screened.problem.known))
        problem, said = corrected(screened.at, base.z, base.q, change.alternative)
        said += (
            f" ({_RIVAL_WORDS.get(change.rival, change.rival)} would explain it about as well)" if change.rival else ""
        )
        before = wrong.get(label, NoiseFault("", ""))
        wrong[label] = NoiseFault("; ".join(filter(None, [before.words, said])), change.rival or before.rival)
        screened = replace(screening, corrected=True)(problem)
    plain = _without_correction(screening, assumed, screened) if wrong else None
    return (screened, wrong, assumed_p) if plain is None else (plain, {}, assumed_p)


def _without_correction(screening: Screening, problem: Problem, corrected: Screened) -> Screened | None:
    """The screen under the noise as assumed, around the effects found under another, where that noise is not needed there.

    Of large effects the nominal fit's linearisation leaves what may look like another noise.
    """
    members = corrected.members
    if not any(cause.slot.columns for cause in members):
        return None
    fit = corrected.fit or fit_with(corrected.at, members)
    plain = screening.around(fit.vector, problem, corrected.pool.visible)
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
        # The levels, too, tell them apart: all of them count as known here.
        under_chosen = chosen.applied(problem, known=True)
        screened = screening_of(under_chosen)(under_chosen)
        listed = [_as_alternative(noise, screened.at) for noise in noises if noise is not chosen]
        # Scatter that no samples show (a head that repeats less well) is no reason to take their noise for slow.
        best = most_probable(screened, [*listed, *screened.alternatives.noise])
        if best is None or best.log_odds < chosen.log_weight:
            break
        if not any(best.alternative is alternative for alternative in listed):
            break
        chosen, screened = next(noise for noise in noises if noise.label == best.alternative.label), None
    return chosen, None if chosen.extrapolated else screened


def _first_tried(at: Tangent, noises: list[MeanNoise]) -> MeanNoise:
    """The first, or the smaller white noise of the samples alone where that goes best with what is left without any cause."""
    rivals = [_as_alternative(noise, at) for noise in noises[1:]]
    evidence = log_noise_evidence(rivals, at.z[None], known=True)[0]
    best = noises[1 + int(np.argmax(evidence))]
    return best if best.lasts == "white" and np.max(evidence) > noises[0].log_weight - 0.5 * at.z @ at.z else noises[0]


def _as_alternative(noise: MeanNoise, at: Tangent) -> NoiseAlternative:
    """A recording's noise as an alternative to that of a problem, whose axes are independent."""
    whitening = np.asarray(at.problem.whitening)
    if whitening.ndim == 1:
        by_axis = whitening.reshape(-1, 3).T
        relative = noise.covariance * by_axis[:, :, None] * by_axis[:, None, :]
    else:
        relative = whitening @ noise.covariance @ whitening.swapaxes(1, 2)
    return alternative_of(at, noise.label, noise.label, noise.log_weight, Covariance.by_axis(relative))


def noise_change(screened: Screened, used: tuple[str, ...]) -> NoiseChange | None:
    """The best noise alternative beside the best causes, where that is what the data favour; else None.

    **Arguments:**

    - `screened`: the screen under the noise as assumed, something being detected.
    - `used`: labels of the noise alternatives that were acted on already.
    """
    listed = [alternative for alternative in screened.alternatives.noise if alternative.label not in used]
    tailed = [alternative for alternative in listed if alternative.tail is not None]
    if _many_outliers(screened) and tailed:
        return most_probable(screened, tailed)
    best = most_probable(screened, listed)
    if best is not None and best.alternative.label == UNEXPLAINED:
        # The repeats show how large the noise is: what comes back in them is none.
        return None
    unexplained = _unexplained_log_odds(screened)
    if best is not None and best.log_odds < unexplained:
        return None
    best = _level_first(screened, listed, best)
    if best is not None and best.log_odds < 0.0:
        # All levels of a kind together may lead where no single one does.
        leading = [alternative for alternative in listed if alternative.label == screened.best.noise]
        best = most_probable(screened, leading) if leading else None
    if best is not None and best.log_odds < unexplained + LEAST_NOISE_ODDS:
        return replace(best, rival=UNEXPLAINED)
    return best


def _unexplained_log_odds(screened: Screened) -> float:
    """Log odds of lack of fit that no entry describes against the best set of causes."""
    return screened.alternatives.lack_of_fit + float(np.log(SIZE_PRIOR[1])) - screened.search.top


def _level_first(screened: Screened, listed: list[NoiseAlternative], best: NoiseChange | None) -> NoiseChange | None:
    """Of a wrong level and another alternative that these data cannot tell from it, the level: it is the simpler."""
    level = most_probable(screened, [alternative for alternative in listed if alternative.kind == LEVEL])
    other = most_probable(screened, [alternative for alternative in listed if alternative.kind != LEVEL])
    if level is None or other is None or best is None or other.alternative.label == level.alternative.label:
        return best
    if abs(other.log_odds - level.log_odds) > LEAST_NOISE_ODDS:
        return best
    return replace(level, rival=other.alternative.label)


def _many_outliers(screened: Screened) -> bool:
    return sum(bool(cause.left_out) for cause in screened.members) >= MANY_OUTLIERS


def most_probable(screened: Screened, listed: list[NoiseAlternative]) -> NoiseChange | None:
    """The noise alternative of a list that, with the causes that go best with it, explains the data best."""
    search, best, most = screened.search, None, -np.inf
    sets = _sets(screened)
    outlying = {k for k, cause in enumerate(search.pool.causes) if cause.left_out}
    many = _many_outliers(screened)
    for members, worth in zip(sets, _worth_trying(screened, sets, listed), strict=True):
        others = tuple(k for k in members if k not in outlying)
        tails_too = many or others == members
        own = [listed[k] for k in np.flatnonzero(worth) if tails_too or listed[k].tail is None]
        scores = joint_log_evidence(screened, members, own)
        kinds = [(alternative.label, alternative.kind) for alternative in own]
        for kind in dict.fromkeys(kinds):
            # Kinds are compared by all their members together: one tried in fine steps is not worse for it.
            of_kind = np.array([other == kind for other in kinds])
            total, number = (
                float(np.logaddexp.reduce(scores[of_kind])),
                int(np.argmax(np.where(of_kind, scores, -np.inf))),
            )
            if total > most:
                most, alternative = total, own[number]
                best = NoiseChange(alternative, members if alternative.tail is None else others, float(scores[number]))
    return None if best is None else NoiseChange(best.alternative, best.members, best.log_odds - search.top)


def _worth_trying(
    screened: Screened, sets: list[tuple[int, ...]], listed: list[NoiseAlternative]
) -> Bool[np.ndarray, "sets alternatives"]:
    """Where the noise, judged by what a set leaves when it is fitted under the noise as assumed, is not hopeless."""
    search = screened.search
    if not listed or not sets:
        return np.zeros((len(sets), len(listed)), bool)
    bases = [search.base(members) for members in sets]
    rest = np.stack([base.z - base.q @ (base.q.T @ base.z) for base in bases])
    normal = log_evidence_of_noise(np.sum(rest**2, axis=1), search.pool.dof, search.known)
    change = log_noise_evidence(listed, rest, search.known) - normal[:, None]
    posterior = np.array([search.posterior(members) for members in sets])
    return posterior[:, None] + change > search.top - _HOPELESS


def joint_log_evidence(
    screened: Screened, members: tuple[int, ...], listed: list[NoiseAlternative]
) -> Float[np.ndarray, " alternatives"]:
    """Log posterior (unnormalised, on the scale of the search's `top`) of one set of causes under each noise alternative."""
    search = screened.search
    base = search.base(members)
    dof, known = search.pool.dof, search.known
    as_assumed = float(log_evidence(np.array(base.z @ base.z), base.explained(base.q.T @ base.z), dof, known))
    prior = log_prior(search.pool, members)
    basis = listed[0].basis if listed else np.zeros((0, len(base.z)))
    rows_z, rows_q = basis @ base.z[:, None], basis @ base.q
    scores = []
    for alternative in listed:
        if alternative.tail is None:
            z = alternative.whitened(rows_z)[:, 0]
            q, _ = np.linalg.qr(alternative.whitened(rows_q))
            stated = known and alternative.kind != LEVEL
            score = (
                float(log_evidence(np.array(z @ z), base.explained(q.T @ z), dof, stated)) - alternative.half_log_det
            )
            scores.append(prior + alternative.log_weight + score)
            continue
        # Tails are judged by what the set leaves; its own part counts as under the normal distribution.
        rest = base.z - base.q @ (base.q.T @ base.z)
        normal = float(log_evidence_of_noise(np.array(rest @ rest), dof, known))
        scores.append(prior + as_assumed + float(log_noise_evidence([alternative], rest[None], known)[0, 0]) - normal)
    return np.array(scores)


def _sets(screened: Screened) -> list[tuple[int, ...]]:
    """The sets worth trying: nothing, those of the best explanations, and every part of the best one; none that leaves no
    degrees of freedom to tell a noise by."""
    listed = [told for told in screened.explanations if told.members][:_MOST_SETS]
    first = listed[0].members if listed else ()
    parts = chain.from_iterable(combinations(first, size) for size in range(len(first) + 1))
    sets = dict.fromkeys([*parts, *(told.members for told in listed)])
    search, dof = screened.search, screened.pool.dof
    return [members for members in sets if search.base(members).q.shape[1] + LEAST_FREE <= dof]
