"""The result of a temperature calibration: parameters over temperature, signals that are no function of it, the improvement."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float

from tumblecal.chain.following import CHANGE
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_use import Use, combined
from tumblecal.data.positions import ATTITUDES, UNKNOWN
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, leaf_of
from tumblecal.data.temperature_curves import Hysteresis, TemperatureCurves
from tumblecal.estimation import exact
from tumblecal.estimation.curves_of_fit import curves_of
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import sensor_of
from tumblecal.estimation.linear_calibration import calibration_with
from tumblecal.ground.axes import AXES
from tumblecal.ground.record import table
from tumblecal.recordings.thermal.thermal_table import SDS, ThermalTable
from tumblecal.thermal import signals as kinds
from tumblecal.thermal.choice import Choice, chosen_model
from tumblecal.thermal.expanded import Test, expanded_g, span_of_bias
from tumblecal.thermal.held_out import HeldOut, between_recordings, held_out
from tumblecal.thermal.model import LEAVES, SENSOR_LEAVES
from tumblecal.thermal.orders import OF_HYSTERESIS, chains_of
from tumblecal.thermal.stated import Stated
from tumblecal.thermal.usual_sizes import HISTORY
from tumblecal.words import sentence


# Systematic residuals above this many standard deviations of a row contradict the model.
_MISFIT = 3.0
# Less than one independent reading tests nothing.
_ONE = 0.5
# A part of the range of temperatures that shows no dependence on them.
_OF_RANGE = 0.25


@dataclass(frozen=True)
class FoundSignal:
    """A signal that is not a function of temperature.

    - `name`: of `thermal.signals.NAMES`. `coefficients`, `sd`: in `unit`, by the names of its components.
    - `half_width_g` (3): its largest size on each axis in these data. `not_separated_from`: effects of the history that may be
      its cause.
    """

    name: str
    unit: str
    coefficients: dict[str, float]
    sd: dict[str, float]
    half_width_g: Float[np.ndarray, "3"]
    not_separated_from: tuple[str, ...]


@dataclass(frozen=True)
class ThermalResult:
    """A calibration over temperature.

    - `choice`: the model and the orders. `fit`: its fit. `noise_factor`: ratio of the residuals to the standard deviations of
      the rows, at least 1; it is in all uncertainties. `signals`: signals that are not functions of temperature.
    - `calibration`: parameters at the reference, curves, hysteresis. `held_out`: errors on held-out rows;
      `between`: on those of each recording at temperatures outside the others.
    - `combinations`: for attitudes that do not determine all leaves, the combination that each curve of a bias contains.
    """

    table: ThermalTable
    choice: Choice
    fit: Fit
    noise_factor: float
    signals: tuple[FoundSignal, ...]
    calibration: Calibration
    held_out: tuple[HeldOut, ...]
    between: tuple[HeldOut, ...]
    combinations: tuple[str, ...]

    @property
    def curves(self) -> TemperatureCurves | None:
        """The parameters over temperature; None if none depends on it."""
        return self.calibration.temperature

    @property
    def reference_degc(self) -> float:
        """The reference temperature."""
        return self.choice.reference_degc

    @property
    def coefficients(self) -> dict[str, dict[str, Any]]:
        """Value, standard uncertainty `sd` without hysteresis, and unit of each coefficient of the curves, base units."""
        if (curves := self.curves) is None:
            return {}
        names = [name for curve in curves.curves for name in curve.coefficient_names]
        units = [unit for curve in curves.curves for unit in curve.units]
        values = np.concatenate([curve.coefficients for curve in curves.curves])
        sd = np.sqrt(np.diag(curves.covariance)[len(SENSOR) :])
        return table(names, value=values, sd=sd, unit=units)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Leaves of the sensor whose values at the reference these attitudes do not determine."""
        return tuple(leaf for leaf in SENSOR_LEAVES if leaf not in self.choice.model.free)


def thermal_calibration(table: ThermalTable, stated: Stated | None = None) -> ThermalResult:
    """Calibrate over temperature.

    **Arguments:**

    - `table`: means in bins of temperature. `stated`: what the user states; the rest is chosen by the data.

    **Raises:** `InputError` for one temperature only, or orders that the temperatures do not determine.
    """
    stated = Stated() if stated is None else stated
    choice = chosen_model(table, stated)
    fit, test = _fitted(choice)
    found = tuple(_found(fit, given, order, choice) for given, order in choice.model.signals)
    return ThermalResult(
        table=table,
        choice=choice,
        fit=fit,
        noise_factor=test.factor,
        signals=found,
        calibration=_calibration(fit, choice, found, stated, test),
        held_out=held_out(choice),
        between=between_recordings(choice),
        combinations=_combinations(choice),
    )


def _fitted(choice: Choice) -> tuple[Fit, Test]:
    """The exact fit, with its residuals in the noise if they exceed it, and the test of the model."""
    model = choice.model
    fit, table = exact.fit(model.problem), model.table
    prior = fit.jacobian[table.readings.size :] / model.problem.scales
    # A prior is as good as a reading for what the readings do not determine, and is none for the rest.
    stated = float(np.einsum("pe,ef,pf->", prior, fit.covariance, prior))
    dof, square = table.readings.size - len(fit.names) + stated, float(np.sum((fit.residuals / table.sd) ** 2))
    factor = max(1.0, float(np.sqrt(square / dof))) if dof >= _ONE else 1.0
    misfit_g = max(noise_of(table) * np.sqrt(factor**2 - 1), _misfit_of_attitudes(table, fit, stated))
    if factor > 1:
        model = replace(model, table=replace(table, frame=table.frame.with_columns(pl.col(SDS) * factor)))
        fit = exact.fit(model.problem, fit.values)
    unchosen = sum(choice.design.families[leaf].shape[1] for leaf in choice.highest if not choice.orders.get(leaf))
    # Readings that repeat others: an attitude with a small part of the range is one size of gravity.
    labels, least = np.array(table.attitude), _OF_RANGE * float(np.ptp(table.temperature_degc))
    parts = [table.temperature_degc[labels == name] for name in table.attitudes]
    repeated = 3 * sum(len(degc) - 1 for degc in parts if np.ptp(degc) < least)
    return fit, Test(factor, float(misfit_g), dof - unchosen - repeated)


def _misfit_of_attitudes(table: ThermalTable, fit: Fit, priors: float) -> float:
    """Systematic error of a component of a reading by the mean residual of each attitude, g; 0 if the attitudes do not show it.

    Tilts that are fitted take two of three components, so the third, the size of gravity, shows that of all.
    """
    labels = np.array(table.attitude)
    means = np.array([fit.residuals[labels == name].mean(0) for name in table.attitudes])
    constants = len(
        [name for name in fit.names if leaf_of(name).removesuffix(CHANGE) == leaf_of(name) not in kinds.NAMES]
    )
    dof = means.size - constants + priors
    return float(np.sqrt(np.sum(means**2) / dof)) if dof >= _ONE else 0.0


def noise_of(table: ThermalTable) -> float:
    """Standard deviation of the readings of a table, root mean square, g."""
    return float(np.sqrt(np.mean(table.sd**2)))


def _found(fit: Fit, given: kinds.Signals, order: int, choice: Choice) -> FoundSignal:
    names = [given.name + (f"_{part}" if part else "") for part in given.names(order)]
    here = [fit.names.index(name) for name in names]
    values, joined = fit.values[here], choice.unseparated
    return FoundSignal(
        given.name,
        given.unit,
        dict(zip(given.names(order), values.tolist(), strict=True)),
        dict(zip(given.names(order), fit.sd[here].tolist(), strict=True)),
        kinds.half_widths(given, order, values),
        tuple(name for name in joined if name != given.name) if given.name in joined else (),
    )


def _calibration(fit: Fit, choice: Choice, found: tuple[FoundSignal, ...], stated: Stated, test: Test) -> Calibration:
    table = choice.model.table
    sensor, span = _sensor(fit, stated.base), measured_range(table)
    curves = curves_of(fit, sensor.covariance)
    widths = sum((signal.half_width_g for signal in found if signal.name != "drift"), np.zeros(3))
    if choice.of_temperature:
        widths = widths + HISTORY * span_of_bias(curves)
    if curves is not None:
        hysteresis = [
            Hysteresis(f"bias_{axis}", float(size), "g", choice.unseparated)
            for axis, size in zip(AXES, widths, strict=True)
            if size > 0
        ]
        # The range is that of the thermometer, also if the sensor is behind it, up to the edges of the outer bins.
        measured = tuple(replace(each, functions=replace(each.functions, range_degc=span)) for each in curves.curves)
        curves = replace(curves, curves=measured, hysteresis=tuple(hysteresis))
    calibration = calibration_with(fit, sensor, curves)
    unknown = {} if table.known_attitudes else {ATTITUDES: UNKNOWN}
    more = {"method": "thermal", "temperature_range_degc": list(span)}
    drift = sum((signal.half_width_g for signal in found if signal.name == "drift"), np.zeros(3))
    expanded = expanded_g(choice, fit, test, calibration, np.hypot(widths, drift), span)
    return replace(
        calibration,
        temperature_degc=choice.reference_degc,
        provenance=calibration.provenance | unknown | more,
        use=_use(choice, stated.base, test, widths, expanded, span),
    )


def measured_range(table: ThermalTable) -> tuple[float, float]:
    """Lowest and highest measured temperature, degC, to 0.01 degC outwards: rows are means, so the outer bins of a ramp extend
    by half of the distance to their neighbours."""
    low, high = table.range_degc
    beyond = [0.0, 0.0]
    for chain in chains_of(table):
        degc = np.sort(table.temperature_degc[chain][~table.soak[chain]])
        if len(degc) < 2:
            continue
        beyond[0] = max(beyond[0], low - float(degc[0] - (degc[1] - degc[0]) / 2))
        beyond[1] = max(beyond[1], float(degc[-1] + (degc[-1] - degc[-2]) / 2) - high)
    return float(np.floor(100 * (low - beyond[0]))) / 100, float(np.ceil(100 * (high + beyond[1]))) / 100


def _sensor(fit: Fit, base: Calibration | None) -> SensorParameters:
    """Parameters at the reference: estimated, otherwise those of `base`, otherwise zero without uncertainty."""
    if set(SENSOR) <= set(fit.names):
        return sensor_of(fit)
    if base is not None:
        return base.sensor.of(SENSOR)
    return SensorParameters(SENSOR, np.zeros(len(SENSOR)), np.zeros((len(SENSOR), len(SENSOR))))


def _use(
    choice: Choice,
    base: Calibration | None,
    test: Test,
    widths: Float[np.ndarray, "3"],
    expanded: float,
    span: tuple[float, float],
) -> Use:
    """Whether the calibration may be used: by its values at the reference, by the residuals, and by a test of the model.

    No form of hysteresis is that of the unit, so residuals of a part of its half-widths (`widths`) do not contradict the model.
    """
    free, noise_g = choice.model.free, noise_of(choice.model.table)
    if base is None and not free:
        return Use("no", sentence("thermal/only_changes"))
    if test.misfit_g > max(_MISFIT * noise_g, OF_HYSTERESIS * float(np.sqrt(np.mean(widths**2)))):
        return Use("no", sentence("thermal/misfit", misfit=1e3 * test.misfit_g, noise=1e3 * noise_g))
    if test.readings < _ONE:
        return Use("not tested", sentence("thermal/no_freedom"))
    missing = [LEAVES[leaf] for leaf in SENSOR_LEAVES if base is None and leaf not in free]
    # Leaves that the user states as constant are not listed.
    changes = [LEAVES[leaf] for leaf in choice.inseparable if leaf in SENSOR_LEAVES]
    reason = sentence("thermal/usual_sizes", at_reference=missing, changes=changes) if missing or changes else ""
    here = Use("within", reason, span)
    if base is None:
        return replace(here, expanded_g=expanded)
    # The temperatures of the stated calibration do not limit this one.
    answer = "yes" if base.use.answer == "within" else base.use.answer
    of_base = replace(base.use, answer=answer, temperature_degc=None)
    return combined([here, of_base], float(np.hypot(expanded, base.use.expanded_g or 0.0)))


def _combinations(choice: Choice) -> tuple[str, ...]:
    """The combination in each curve of a bias, if the attitudes do not determine the change of other leaves."""
    functions, table = choice.model.functions, choice.model.table
    missing = choice.inseparable
    if not functions or not missing or len(table.attitudes) > 1:
        return ()
    force = np.mean(table.readings, axis=0)
    x, y, z = force / np.linalg.norm(force)
    # Derivatives of the reading of each axis by the parameters, for an ideal triad.
    by = {
        "x": {"dK_x": x, "dtheta_y": -z, "dtheta_z": y},
        "y": {"dK_y": y, "gamma_21": x, "dtheta_x": z, "dtheta_z": -x},
        "z": {"dK_z": z, "gamma_31": x, "gamma_32": y, "dtheta_x": -y, "dtheta_y": x},
    }
    lines = []
    for axis, shares in by.items():
        terms = [
            f"{'+' if share > 0 else '-'} {abs(share):.2f} {name}"
            for name, share in shares.items()
            if leaf_of(name) in missing and abs(share) >= 0.005
        ]
        lines.append(" ".join([f"bias_{axis}", *terms]))
    return tuple(lines)
