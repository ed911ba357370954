"""Effects that jump with the sign of an input, tried with the leading causes. If an input near zero has the wrong sign, such
an effect is invisible, or looks like a different error."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.exact.insert import fit_with
from tumblecal.diagnosis.exact.kinks import kink_start, most_left, turns_a_sign
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import MOST, Members
from tumblecal.diagnosis.tuning import CONTRADICTED, KINK, UNMOVED
from tumblecal.estimation.problem import Problem


# Effects that are fitted exactly each by itself.
_MOST_ALONE = 6
# A problem screened around a full vector; of its effects those in the set count as visible.
Around = Callable[[Float[np.ndarray, " full"], Problem, frozenset[str]], Screened]


def signs_sought(screened: Screened, around: Around) -> Screened:
    """The screen around the solution with a jump, alone or with parts of the leading set, if a set is more probable there."""
    start = kink_start(screened.at, screened.members, screened.sigma)
    return screened if start is None else _better_around(start, screened, around)


def each_alone(screened: Screened, around: Around) -> Screened:
    """The screen around the exact fit of an effect that alone explains nearly all by the linear screen, if that fit is more
    probable than the leading explanation. For a large effect with a kink the linear screen may leave far more than noise."""
    search, at = screened.search, screened.at
    alone = [(k,) for k in screened.pool.effects.tolist() if (k,) != screened.best.members]
    left = np.array([base.left for base in search.bases(alone)])
    top, vector = screened.top, None
    for number in np.argsort(left, kind="stable")[:_MOST_ALONE].tolist():
        if left[number] > CONTRADICTED * float(at.z @ at.z):
            break
        fit = fit_with(at, [screened.pool.causes[k] for k in alone[number]])
        posterior = search.posterior_at(alone[number], fit.chi2)
        if fit.code.good and posterior > top:
            top, vector = posterior, fit.vector
    return screened if vector is None else _better_around(vector, screened, around)


def with_a_jump(screened: Screened, around: Around) -> Screened:
    """The screen around the exact fit of an effect that jumps with an input's sign, where that explains more."""
    causes, best = screened.pool.causes, screened.best.members
    faults = tuple(k for k in best if causes[k].positions)
    if not screened.of_effects:
        at, members = screened.at, screened.members
        tried = [(at, members, ())]
        if screened.large:
            # Faults may have the signal of the effect, or occur with it.
            tried += [(*screened.undone(own), ()) for own in _each_without_one(faults)]
            tried += [(at, tuple(causes[k] for k in own), members) for own in screened.parts_of_leading_effects[:1]]
        for own, others, leads in tried:
            start = kink_start(own, others, screened.sigma, leads)
            better = screened if start is None else _better_around(start, screened, around)
            if better is not screened:
                return better
    effects = tuple(k for k in best if causes[k].slot.columns)
    own, large = (faults, effects, (*faults, *effects)), screened.large
    for beside in dict.fromkeys((*own, *screened.parts_of_leading_effects)):
        for k in screened.pool.effects.tolist():
            cause = causes[k]
            if not cause.slot.kinked or k in best or len(beside) >= MOST:
                continue
            together = [*(causes[other] for other in beside), cause]
            small = not large and all(other.slot.columns for other in together)
            if small and not turns_a_sign(screened.at, together):
                continue
            fit = fit_with(screened.at, together)
            gains = fit.chi2 <= screened.search.left((*beside, k)) - KINK * screened.sigma**2
            if not gains or (large and fit.chi2 > most_left(screened.at, screened.sigma)):
                continue
            better = _better_around(fit.vector, screened, around)
            if better is not screened and (beside in own or better.settled):
                return better
    return screened


def _better_around(vector: Float[np.ndarray, " full"], screened: Screened, around: Around) -> Screened:
    """The screen around a full vector where a set is more probable in it; else the one given. Where the same leads, it must
    be so by more than a little, and have an effect that jumps: else no sign mattered."""
    again, gain = around(vector, screened.problem, screened.pool.visible), 0.0
    if again.best.labels == screened.best.labels:
        gain = 0.5 * UNMOVED if any(cause.slot.kinked for cause in again.members) else np.inf
    return again if again.detection.detected and again.top > screened.top + gain else screened


def _each_without_one(faults: Members) -> list[Members]:
    """All of some faults, and all but each of them."""
    fewer = (faults[:k] + faults[k + 1 :] for k in range(len(faults)))
    return [own for own in (faults, *fewer) if own]
