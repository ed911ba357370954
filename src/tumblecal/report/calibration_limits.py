"""Limits of the use of a calibration that follow from its data and from the corrections that its file does not contain.

`calibrate` and `diagnose` share them. Each finding yields a `Use`; `calibration_use.combined` takes the strictest.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration_use import Use
from tumblecal.data.coverage_factor import coverage_factors
from tumblecal.data.not_applied import NotApplied
from tumblecal.data.position_comments import identity_words
from tumblecal.data.positions import PositionSet
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import matrix_and_bias, one_sensor
from tumblecal.ground.soaks import ONE_TEMPERATURE_DEGC
from tumblecal.ground.units import in_words
from tumblecal.noise.within_dwells import TEMPERATURE, changes_within_dwells
from tumblecal.report.sensor_terms import NOT_MISSED, SensorTerms


# Directions of gravity at which readings are compared: faces, edges and corners of a cube.
DIRECTIONS = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]
_SCALES = tuple(name for name in SENSOR if name.startswith("dK_"))
_LEVEL = 0.95


def limits(fit: Fit, terms: SensorTerms, written: Float[np.ndarray, "12 12"] | None = None) -> Iterator[Use]:
    """All limits of a converged fit's calibration that do not depend on its residuals.

    `fit`: with the parameters of the file. `terms`: of the file. `written`: covariance of matrix and bias, if not the fit's.
    """
    if one_sensor(fit):
        significant_g = expanded_uncertainty(fit, written)
        yield from _losses(terms.losses(fit.data.temperature_degc), significant_g)
        yield from _within_dwells(fit.data, significant_g, thermal=terms.thermal)
    if words := identity_words(fit.data):
        yield Use("yes", f"{words[:1].lower()}{words[1:]}")
    yield from temperature_use(fit.data)


def expanded_uncertainty(fit: Fit, written: Float[np.ndarray, "12 12"] | None = None) -> float:
    """The largest expanded uncertainty (95 %) of a corrected reading at 1 g, g."""
    matrix, _, by_fit = matrix_and_bias(fit)
    covariance = by_fit if written is None else written
    readings = DIRECTIONS @ np.linalg.inv(matrix).T
    # f_r = sum_c matrix_rc (A_c - bias_c): derivative by the row of the matrix, and by the bias.
    slope = np.zeros((len(DIRECTIONS), 3, 12))
    for row in range(3):
        slope[:, row, 3 * row : 3 * row + 3] = readings
    slope[:, :, 9:] = -matrix
    variance = np.einsum("nrp,pq,nrq->nr", slope, covariance, slope)
    dof = np.inf if fit.noise == "stated" else max(float(fit.dof), 1.0)
    return float(np.sqrt(np.max(variance)) * coverage_factors(np.array([dof]), _LEVEL)[0])


def _losses(losses: Sequence[NotApplied], significant_g: float) -> Iterator[Use]:
    """An effect of the sensor that the file cannot contain limits the use to its size in the data, if that exceeds the
    uncertainty."""
    for loss in losses:
        if loss.reason in NOT_MISSED:
            continue
        reason = f"{loss.effect} is not in this calibration ({loss.reason})"
        if loss.largest_mg is None:
            yield Use("yes", reason)
        elif 1e-3 * loss.largest_mg > significant_g:
            yield Use("within", reason, size_g=1e-3 * loss.largest_mg)


def _within_dwells(data: PositionSet, significant_g: float, *, thermal: bool) -> Iterator[Use]:
    """A change within dwells limits the use to its size, unless the file has terms of the temperature that it follows."""
    for variable, change_g in changes_within_dwells(data.comments):
        if variable == TEMPERATURE and thermal:
            continue
        follows = variable or "time or temperature"
        reason = f"the readings change within dwells with {follows}"
        if change_g is None:
            yield Use("yes", reason)
        elif change_g > significant_g:
            yield Use("within", reason, size_g=change_g)


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
        names = tuple(name for name in SENSOR if name not in _SCALES)
        yield Use(
            "only", "the gravity of the site is not stated, so the scale factors are not determined", parameters=names
        )


def undetermined_use(fit: Fit) -> Iterator[Use]:
    """Parameters that the data cannot separate from an effect are not determined."""
    missing = [name for name in fit.undetermined if name in SENSOR]
    if missing:
        names = tuple(name for name in SENSOR if name not in missing)
        reason = f"these positions do not determine {', '.join(missing)}"
        yield Use("only", reason, parameters=names) if names else Use("no", reason)
