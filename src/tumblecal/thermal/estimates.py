"""Residuals and estimates of a temperature calibration by bin, as figures show them: without its signals, which no correction
includes."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from tumblecal.data.sensor_parameters import SENSOR, leaf_of
from tumblecal.ground.soaks import soaks
from tumblecal.thermal.result import ThermalResult


# Cells of temperature over the range; a table with fewer soaks than this has a cell for each soak.
_CELLS = 40
# An estimate with more than this many times the median uncertainty is not determined by the attitudes of its cell.
_WEAKEST = 10.0


@dataclass(frozen=True)
class BinEstimates:
    """The nine sensor parameters by temperature and direction of change, base units; NaN where the attitudes of a cell do not
    determine a parameter, or where the calibration has it constant.

    - `direction`: +1 for cells that were reached by rising temperature, -1 by falling, 0 if it did not change.
    """

    degc: Float[np.ndarray, " cells"]
    direction: Int[np.ndarray, " cells"]
    values: Float[np.ndarray, "cells 9"]


def varying(result: ThermalResult) -> list[str]:
    """The parameters that follow temperature."""
    return [] if result.curves is None else [curve.parameter for curve in result.curves.curves]


def known_at_reference(result: ThermalResult, parameter: str) -> bool:
    """Whether the value of a parameter at the reference temperature is known, and not only its change."""
    model = result.choice.model
    return bool(model.fixed) or leaf_of(parameter) in model.free


def after_correction(result: ThermalResult) -> Float[np.ndarray, "rows 3"]:
    """Readings less those of the parameters at their temperatures, g: hysteresis, rate, lag and drift remain."""
    found = zip(result.choice.model.signals, result.signals, strict=True)
    remaining = sum(
        (np.tensordot([*signal.coefficients.values()], given.up_to(order), 1) for (given, order), signal in found),
        np.zeros_like(result.table.readings),
    )
    return result.fit.residuals + remaining


def before_correction(result: ThermalResult) -> Float[np.ndarray, "rows 3"]:
    """Readings less those of the parameters at the reference temperature, g."""
    if (curves := result.curves) is None:
        return after_correction(result)
    change = curves.at(result.table.temperature_degc)
    return after_correction(result) + np.einsum("rap,rp->ra", _by_parameters(result), change)


def bin_estimates(result: ThermalResult) -> BinEstimates:
    """Estimates of the parameters that follow temperature from the rows of each cell of temperature and direction alone."""
    table, here = result.table, [SENSOR.index(name) for name in varying(result)]
    cells, degc, direction = cells_of(table.temperature_degc), list[float](), list[int]()
    white = after_correction(result) / table.sd
    design = _by_parameters(result)[:, :, here] / table.sd[:, :, None]
    changes, sd = list[np.ndarray](), list[np.ndarray]()
    for cell, sign in sorted({*zip(cells.tolist(), table.reached_by.tolist(), strict=True)}):
        rows = (cells == cell) & (table.reached_by == sign)
        columns = design[rows].reshape(-1, len(here))
        if np.linalg.matrix_rank(columns, rtol=1e-3) < len(here):
            continue
        inverse = np.linalg.pinv(columns)
        degc.append(float(np.mean(table.temperature_degc[rows])))
        direction.append(sign)
        changes.append(inverse @ white[rows].ravel())
        sd.append(np.linalg.norm(inverse, axis=1))
    values = np.full((len(degc), len(SENSOR)), np.nan)
    if changes:
        values[:, here] = np.where(sd < _WEAKEST * np.median(sd, axis=0), changes, np.nan)
    return BinEstimates(np.array(degc), np.array(direction, int), values + parameters_at(result, np.array(degc)))


def parameters_at(result: ThermalResult, degc: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "rows 9"]:
    """The parameters at temperatures; for those that are not known at the reference, their changes since there."""
    values = np.zeros((len(degc), len(SENSOR))) if result.curves is None else result.curves.at(degc)
    known = [known_at_reference(result, name) for name in SENSOR]
    return values + np.where(known, result.calibration.sensor.of(SENSOR).values, 0.0)


def sd_at(result: ThermalResult, degc: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "rows 9"]:
    """Standard uncertainties of `parameters_at`, with hysteresis."""
    curves = result.curves
    assert curves is not None
    changes = curves.covariance.copy()
    unknown = [k for k, name in enumerate(SENSOR) if not known_at_reference(result, name)]
    changes[unknown] = changes[:, unknown] = 0.0
    return replace(curves, covariance=changes).sd(degc)


def cells_of(degc: Float[np.ndarray, " rows"]) -> Int[np.ndarray, " rows"]:
    """Number of the cell of each temperature: a cell for each soak, or cells of equal width over the range."""
    distinct = np.array(soaks(degc))
    if len(distinct) <= _CELLS:
        return np.argmin(np.abs(degc[:, None] - distinct), axis=1)
    width = float(np.ptp(degc)) / _CELLS
    return np.minimum(((degc - degc.min()) / width).astype(int), _CELLS - 1)


def _by_parameters(result: ThermalResult) -> Float[np.ndarray, "rows 3 9"]:
    """Derivatives of the readings by the sensor parameters, of first order in the errors."""
    table = result.table
    force = result.calibration.corrected(table.readings, table.temperature_degc, extrapolate=True)
    slope = np.zeros((len(table), 3, len(SENSOR)))
    # dK and bias of each axis, then gamma_21, gamma_31 and gamma_32.
    slope[:, range(3), range(3)] = force
    slope[:, range(3), range(3, 6)] = 1.0
    slope[:, [1, 2, 2], range(6, 9)] = force[:, [0, 0, 1]]
    return slope
