"""Limits of the use of a calibration that follow from its data and from the corrections that its file does not contain.

`calibrate` and `diagnose` share them. Each finding yields a `Use`; `calibration_use.combined` takes the strictest.
"""

from collections.abc import Iterator

import numpy as np

from tumblecal.data.calibration_use import Use
from tumblecal.data.position_comments import identity_words
from tumblecal.data.positions import PositionSet
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.estimation.fit import Fit
from tumblecal.ground.soaks import ONE_TEMPERATURE_DEGC
from tumblecal.ground.units import in_words
from tumblecal.lab.sensor_terms import NOT_MISSED, SensorTerms
from tumblecal.noise.within_dwells import TEMPERATURE, changes_within_dwells


NO_GRAVITY = "the gravity of the site is not stated, so the scale factors are not determined"
_SCALES = tuple(name for name in SENSOR if name.startswith("dK_"))


def limits(data: PositionSet, terms: SensorTerms) -> Iterator[Use]:
    """All limits of a calibration that do not depend on its residuals; `terms`: of its file."""
    for size_g, reason in _corrections_missing(data, terms):
        # A correction of unknown size is missing in an unknown U.
        yield Use("not tested" if size_g is None else "yes", reason)
    if words := identity_words(data):
        yield Use("yes", f"{words[:1].lower()}{words[1:]}")
    yield from temperature_use(data)


def systematic_g(data: PositionSet, terms: SensorTerms) -> float:
    """The sum of the systematic errors of known size that the file does not correct, g. U includes it (JCGM 100, F.2.4.5)."""
    return sum(size_g or 0.0 for size_g, _ in _corrections_missing(data, terms))


def _corrections_missing(data: PositionSet, terms: SensorTerms) -> Iterator[tuple[float | None, str]]:
    """Each systematic error that the file does not correct: its largest size in the data (g; None: not known), and words."""
    for loss in terms.losses(data.temperature_degc):
        if loss.reason not in NOT_MISSED:
            yield _sized(loss.largest_mg, f"{loss.effect} is not in this calibration ({loss.reason})")
    for variable, change_g in changes_within_dwells(data.comments):
        if variable != TEMPERATURE or not terms.thermal:
            change_mg = None if change_g is None else 1e3 * change_g
            follows = variable or "time or temperature"
            yield _sized(change_mg, f"the readings change within dwells with {follows}")


def _sized(largest_mg: float | None, reason: str) -> tuple[float | None, str]:
    if largest_mg is None:
        return None, f"{reason}, and its size is not known"
    return 1e-3 * largest_mg, f"{reason}; U includes its largest size, {in_words(f'{largest_mg:.2g}', 'mg')}"


def temperature_use(data: PositionSet) -> Iterator[Use]:
    """A calibration is valid at the recorded temperatures of its measurement. A single temperature is no range: it is only
    stated."""
    degc = data.temperature_degc
    if degc is None:
        return
    limits = float(np.min(degc)), float(np.max(degc))
    if limits[1] - limits[0] > ONE_TEMPERATURE_DEGC:
        yield Use("within", "a dependence on temperature outside this range was not measured", limits)
    else:
        at = in_words(f"{np.mean(degc):.4g}", "degC")
        yield Use("yes", f"measured at about {at}; a dependence on temperature was not measured")


def gravity_use(fit: Fit) -> Iterator[Use]:
    """Without a stated gravity the scale factors of readings in m/s^2 are not determined."""
    if fit.data.gravity is not None and fit.data.gravity.assumed:
        names = tuple(name for name in fit.names if name in SENSOR and name not in _SCALES)
        yield Use("only", NO_GRAVITY, parameters=names)


def undetermined_use(fit: Fit) -> Iterator[Use]:
    """Parameters that the data cannot separate from an effect are not determined."""
    missing = [name for name in fit.undetermined if name in SENSOR]
    if missing:
        names = tuple(name for name in SENSOR if name not in missing)
        reason = f"these positions do not determine {', '.join(missing)}"
        yield Use("only", reason, parameters=names) if names else Use("no", reason)
