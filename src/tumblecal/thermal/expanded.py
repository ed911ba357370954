"""Expanded uncertainty of a corrected reading, with everything that the chosen model may have missed.

The largest model has every leaf of the sensor, with one order of temperature more than the data determine. What the chosen
model contains is free in it; everything else has its usual size as a prior. Its posterior covariance and the
difference of its mean from the chosen model give the error of a corrected reading at each temperature of the range.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.sensor_parameters import SENSOR, correction_slope, leaf_of
from tumblecal.data.temperature_curves import TemperatureCurves
from tumblecal.estimation.fit import Fit
from tumblecal.lab.corrected_reading import expanded_uncertainty
from tumblecal.thermal.choice import Choice
from tumblecal.thermal.design import Design
from tumblecal.thermal.orders import chains_of, independent_share
from tumblecal.thermal.usual_sizes import NEXT_ORDER, SLOPE


# Temperatures of the range at which errors are compared.
_GRID = 33
# Least size of what is not determined: numbers only.
_LEAST = 1e-12


class Test(NamedTuple):
    """The test of a model by its residuals.

    - `factor`: ratio of the residuals to the noise of the table, at least 1. `misfit_g`: root mean square of the residuals less
      this noise, or of their means by attitude if that is larger, g. `readings`: number of independent readings that test the
      model.
    """

    factor: float
    misfit_g: float
    readings: float


def expanded_g(
    choice: Choice,
    fit: Fit,
    test: Test,
    calibration: Calibration,
    by_history: Float[np.ndarray, "3"],
    span_degc: tuple[float, float],
) -> float:
    """U (k = 2) of each component of a corrected reading, g: the largest over attitudes and measured temperatures.

    **Arguments:**

    - `fit`, `calibration`: of the chosen model, with its `test`. `by_history` (3): half-widths of the effects of the history of
      the temperature, and of drift, g. `span_degc`: measured range.
    """
    covariance, shift = _posterior(choice, fit, test.factor)
    sensor = calibration.sensor.of(SENSOR)
    of_readings = by_history**2 / 3 + test.misfit_g**2
    constant = np.zeros((9, 9)) if choice.model.free else sensor.covariance
    constant = constant + np.diag([0.0] * 3 + of_readings.tolist() + [0.0] * 3)
    found, slope = [], correction_slope(sensor.values)
    for by in _parameters(choice.everything, np.linspace(*span_degc, _GRID)):
        of_sensor = by @ (covariance + np.outer(shift, shift)) @ by.T + constant
        found.append(expanded_uncertainty(calibration.matrix, slope @ of_sensor @ slope.T))
    return max(found)


def _posterior(
    choice: Choice, fit: Fit, factor: float
) -> tuple[Float[np.ndarray, "free free"], Float[np.ndarray, " free"]]:
    """Covariance of the parameters of the largest model, and their mean less the fit; signals of the chosen model are free."""
    design, table, sd = choice.everything, choice.model.table, choice.model.table.sd.ravel()
    signals = [given.up_to(order).reshape(-1, len(sd)).T / sd[:, None] for given, order in choice.model.signals]
    changes = design.columns({name: len(each) for name, each in design.families.items()})
    columns = np.column_stack([design.constant, changes, *signals])
    constants, count = len(design.names), len(design.names) + changes.shape[1]
    information = np.zeros((columns.shape[1],) * 2)
    information[:constants, :constants] = design.prior.T @ design.prior
    information[constants:count, constants:count] = np.diag(_usual(choice) ** -2.0)
    white = fit.residuals.ravel() / sd
    share = independent_share(white.reshape(-1, 3), chains_of(table)) / factor**2
    information += share * columns.T @ columns
    scale = np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    shift = share * covariance @ columns.T @ white
    return covariance[:count, :count], shift[:count]


def _usual(choice: Choice) -> Float[np.ndarray, " changes"]:
    """Usual sizes of changes that the chosen model does not contain; infinite for the others, and for the linear changes of
    leaves whose change the data determine: these give the sizes of higher orders."""
    # Root mean square distance from the middle of the range.
    degc, design = float(np.ptp(choice.model.table.range_degc)) / np.sqrt(12), choice.design
    linear, start = {leaf: degc * size for leaf, size in SLOPE.items()}, len(design.names)
    values, parts = design.coefficients(dict.fromkeys(choice.highest, 1)), list[np.ndarray]()
    for leaf in choice.highest:
        stop = start + design.families[leaf].shape[1]
        linear[leaf], start = float(np.sqrt(np.mean(values[start:stop] ** 2))), stop
    for leaf, columns in choice.everything.families.items():
        order = np.repeat(np.arange(len(columns)), columns.shape[1])
        chosen = max(choice.orders.get(leaf, 0), int(leaf in choice.highest))
        parts.append(np.where(order < chosen, np.inf, np.maximum(linear[leaf] * NEXT_ORDER**order, _LEAST)))
    return np.concatenate(parts)


def span_of_bias(curves: TemperatureCurves | None) -> Float[np.ndarray, "3"]:
    """The change of each bias over the range, g."""
    if curves is None:
        return np.zeros(3)
    return np.ptp(curves.at(np.linspace(*curves.range_degc, _GRID))[:, 3:6], axis=0)


def _parameters(design: Design, degc: Float[np.ndarray, " grid"]) -> Float[np.ndarray, "grid 9 free"]:
    """Derivatives of the sensor's parameters at temperatures by the parameters of a design."""
    parts = [np.tile(np.array([[name == each for each in design.names] for name in SENSOR], float), (len(degc), 1, 1))]
    for leaf, columns in design.families.items():
        width = columns.shape[1]
        of = np.array([[leaf_of(name) == leaf for _ in range(width)] for name in SENSOR], float)
        of[of.any(1)] = np.eye(width)[: int(of.any(1).sum())]
        values = design.functions[leaf].orthonormal(degc)
        parts.append(np.einsum("kg,pc->gpkc", values, of).reshape(len(degc), len(SENSOR), -1))
    return np.concatenate(parts, axis=2)
