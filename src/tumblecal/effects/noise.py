"""Faults of the noise model, not of the mean."""

from tumblecal.effects.effect import Effect


def _entry(id: str, physics: str, cause: str, advice: str, source: str) -> Effect:
    return Effect(id, physics, "", 0.0, cause, advice, source, kind="noise")


ENTRIES = (
    _entry(
        "noise_unequal",
        "a different noise sd on an axis, at a pitch setting, in a run or mounting, or for large inputs",
        "Some readings are noisier than others (an axis, a setting, large inputs).",
        "State the standard deviation of each reading in the sd columns; find the cause of the larger noise.",
        "Bartlett (1937); restricted likelihood of Patterson and Thompson (1971)",
    ),
    _entry(
        "noise_level",
        "every stated sd wrong by one factor",
        "The stated noise is wrong by one factor for all readings.",
        "State the sd that is estimated from the data, or state none: it is then estimated.",
        "chi-square test of the residuals",
    ),
    _entry(
        "noise_coloured",
        "noise correlated from position to position in measuring order",
        "The noise is slow (1/f, temperature): errors of neighbouring positions are correlated, and averaging longer "
        "helps little.",
        "Average shorter, return to a reference position often, measure in random order.",
        "IEEE 952 (bias instability)",
    ),
    _entry(
        "noise_heavy_tail",
        "single readings with errors far larger than the rest",
        "A few readings have much larger errors than the others: shocks, spikes, lost samples.",
        "Use the median of the raw samples; look for shocks in the recording.",
        "Student's t errors, Lange, Little and Taylor (1989)",
    ),
    _entry(
        "noise_attitude",
        "a small random rotation of the attitude of every position: errors across gravity, none along it",
        "The attitudes are less exact than the readings: the errors are perpendicular to gravity, as errors of angles are.",
        "Read or lock the angles better; averaging longer does not help. State the standard deviation of the angles, not that "
        "of the readings.",
        "errors of a rotation, w x f",
    ),
)
