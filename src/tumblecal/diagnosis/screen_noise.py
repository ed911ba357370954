"""The screen and the noise model together: where the noise is wrong as well, weights are corrected and all is done again."""

from dataclasses import replace

from tumblecal.diagnosis.joint_noise import most_probable, noise_change
from tumblecal.diagnosis.linear import Weighting
from tumblecal.diagnosis.sample_noise import SampleNoise
from tumblecal.diagnosis.screen import Measured, Screened, screen
from tumblecal.diagnosis.whitening import corrected, leftover


_MOST_REWEIGHTINGS = 3


def chosen_sample_noise(measured: Measured, noises: list[SampleNoise]) -> SampleNoise | None:
    """The one of the raw samples' noise models that goes best with the scatter of the positions, causes allowed."""
    chosen = noises[0] if noises else None
    for _ in noises:
        assert chosen is not None
        # The levels, too, tell them apart: all of them count as known here.
        now = replace(chosen.weighting(measured.how), known=True)
        screened = screen(replace(measured, how=now, given=now))
        listed = [one.alternative(screened.linear, now) for one in noises if one is not chosen]
        # Scatter that no samples show (a head that repeats less well) is no reason to take their noise for slow.
        best = most_probable(screened, [*listed, *screened.noise])
        if best is None or best.log_odds < chosen.log_weight or not any(best.alternative is one for one in listed):
            break
        chosen = next(one for one in noises if one.label == best.alternative.label)
    return chosen


def screen_with_noise(measured: Measured) -> tuple[Screened, Weighting, dict[str, str], float]:
    """Screen; where the noise model is wrong as well, correct the weights and screen again.

    **Returns:** the screen, its weights, what was wrong with the noise in words, first p-value.
    """
    screened = screen(measured)
    found, assumed_p = {}, screened.detection.p_value
    used: list[tuple[str, bool]] = []
    for _ in range(_MOST_REWEIGHTINGS):
        # Once the level is corrected, unequal axes may still be found.
        tried = tuple(label for label, known in used if known == measured.how.known)
        change = noise_change(screened, tried) if screened.detection.detected else None
        if change is None:
            break
        base = screened.search.base(change.members)
        label = change.alternative.label
        used.append((label, measured.how.known))
        how, said = corrected(measured.how, leftover(measured.how, screened.linear, base.z, base.q), change.alternative)
        found[label] = "; ".join([*([found[label]] if label in found else []), said])
        measured = replace(measured, how=how)
        screened = screen(measured)
    return screened, measured.how, found, assumed_p
