"""The result of a temperature calibration: parameters over temperature, signals that are no function of it, the improvement."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tumblecal.capture.thermal.thermal_table import ThermalTable
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_use import YES, Use, combined
from tumblecal.data.positions import ATTITUDES, UNKNOWN
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, leaf_of
from tumblecal.data.temperature_curves import Hysteresis, TemperatureCurves
from tumblecal.estimation import exact
from tumblecal.estimation.curves_of_fit import curves_of
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import sensor_of
from tumblecal.estimation.linear_calibration import calibration_with
from tumblecal.ground.axes import AXES
from tumblecal.thermal import signals as kinds
from tumblecal.thermal.choice import Choice, Stated, chosen_model
from tumblecal.thermal.held_out import HeldOut, between_recordings, held_out
from tumblecal.thermal.model import LEAVES, SENSOR_LEAVES
from tumblecal.thermal.orders import chains_of


_LAG_ROUNDS = 3
# Residuals above this many standard uncertainties of the bins are a systematic error, not noise.
_MISFIT = 3.0


@dataclass(frozen=True)
class FoundSignal:
    """A signal that is not a function of temperature.

    - `name`: `hysteresis`, `rate`, `lag` or `drift`. `coefficients`, `sd`: in `unit`, in the order of `components`.
    - `half_width` (3): its largest size on each axis in these data, g. `not_separated`: other signals that explain the data
      almost as well.
    """

    name: str
    components: tuple[str, ...]
    unit: str
    coefficients: Float[np.ndarray, " components"]
    sd: Float[np.ndarray, " components"]
    half_width: Float[np.ndarray, "3"]
    not_separated: tuple[str, ...]


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
    choice, fit, factor = _fitted(chosen_model(table, stated))
    found = tuple(_found(fit, given, order, choice) for given, order in choice.model.signals)
    return ThermalResult(
        table=table,
        choice=choice,
        fit=fit,
        noise_factor=factor,
        signals=found,
        calibration=_calibration(fit, choice, found, stated, factor),
        held_out=held_out(choice),
        between=between_recordings(choice),
        combinations=_combinations(choice),
    )


def _fitted(choice: Choice) -> tuple[Choice, Fit, float]:
    """The exact fit; a lag shifts the temperatures until its column has nothing to explain."""
    model = choice.model
    fit = exact.fit(model.problem)
    for _ in range(_LAG_ROUNDS if "lag" in fit.names else 0):
        model = replace(model, lag_s=model.lag_s + fit.value("lag"))
        fit = exact.fit(model.problem, np.where(np.array(fit.names) == "lag", 0.0, fit.values))
    factor = max(1.0, fit.level) if fit.dof > 0 else 1.0
    if factor > 1:
        fit = replace(fit, covariance=fit.covariance * factor**2)
    return replace(choice, model=model), fit, factor


def _found(fit: Fit, given: kinds.Signals, order: int, choice: Choice) -> FoundSignal:
    names = [given.name + (f"_{part}" if part else "") for part in given.names(order)]
    here = [fit.names.index(name) for name in names]
    # After the last shift of the temperatures the column of the lag explains the rest of it.
    values = fit.values[here] + (choice.model.lag_s if given.name == "lag" else 0.0)
    return FoundSignal(
        given.name,
        given.names(order),
        given.unit,
        values,
        fit.sd[here],
        kinds.half_widths(given, order, values),
        choice.not_separated.get(given.name, ()),
    )


def _calibration(
    fit: Fit, choice: Choice, found: tuple[FoundSignal, ...], stated: Stated, factor: float
) -> Calibration:
    table = choice.model.table
    sensor, span = _sensor(fit, stated.base), measured_range(table)
    curves = curves_of(fit, sensor.covariance)
    if curves is not None:
        total = sum((signal.half_width for signal in found if signal.name != "drift"), np.zeros(3))
        widths = [
            Hysteresis(f"bias_{axis}", float(size), "g") for axis, size in zip(AXES, total, strict=True) if size > 0
        ]
        # The range is that of the thermometer, also if the sensor is behind it, up to the edges of the outer bins.
        measured = tuple(replace(each, functions=replace(each.functions, range_degc=span)) for each in curves.curves)
        curves = replace(curves, curves=measured, hysteresis=tuple(widths))
    calibration = calibration_with(fit, sensor, curves)
    unknown = {} if table.known_attitudes else {ATTITUDES: UNKNOWN}
    more = {"method": "thermal", "temperature_range_degc": list(span)}
    return replace(
        calibration,
        temperature_degc=choice.reference_degc,
        provenance=calibration.provenance | unknown | more,
        use=_use(choice, stated, factor),
    )


def measured_range(table: ThermalTable) -> tuple[float, float]:
    """Lowest and highest measured temperature, degC: rows are means, so the outer bins of a ramp extend by half of the distance
    to their neighbours."""
    low, high = table.range_degc
    beyond = [0.0, 0.0]
    for rows in chains_of(table):
        degc = np.sort(table.temperature_degc[rows][~table.soak[rows]])
        if len(degc) < 2:
            continue
        beyond[0] = max(beyond[0], low - float(degc[0] - (degc[1] - degc[0]) / 2))
        beyond[1] = max(beyond[1], float(degc[-1] + (degc[-1] - degc[-2]) / 2) - high)
    return low - beyond[0], high + beyond[1]


def _sensor(fit: Fit, base: Calibration | None) -> SensorParameters:
    """Parameters at the reference: estimated, otherwise those of `base`, otherwise zero without uncertainty."""
    if set(SENSOR) <= set(fit.names):
        return sensor_of(fit)
    if base is not None:
        return base.sensor.of(SENSOR)
    return SensorParameters(SENSOR, np.zeros(len(SENSOR)), np.zeros((len(SENSOR), len(SENSOR))))


def _use(choice: Choice, stated: Stated, factor: float) -> Use:
    """Whether the calibration may be used: by its values at the reference, by the changes that the attitudes determine, and by
    the size of the residuals."""
    free = choice.model.free
    if stated.base is None and not free:
        reason = (
            "these attitudes do not determine bias and scale factor at the reference temperature, only their changes; add the "
            "calibration of the unit with --calibration, or record six or more attitudes"
        )
        return Use("no", reason)
    uses = [YES if stated.base is None else stated.base.use]
    if stated.base is None and len(free) < len(SENSOR_LEAVES):
        missing = ", ".join(LEAVES[leaf] for leaf in SENSOR_LEAVES if leaf not in free)
        reason = f"these attitudes do not determine the {missing} at the reference temperature; a usual size is assumed"
        uses.append(Use("only", reason, parameters=_of_leaves(free)))
    # Leaves that the user states as constant are not listed.
    joined = [leaf for leaf in choice.inseparable if leaf in SENSOR_LEAVES]
    if joined:
        words = ", ".join(LEAVES[leaf] for leaf in joined)
        reason = f"the change of the {words} with temperature is included in that of the bias: valid in the recorded attitudes"
        uses.append(Use("only", reason, parameters=_of_leaves([leaf for leaf in SENSOR_LEAVES if leaf not in joined])))
    if factor > _MISFIT:
        reason = f"the residuals are {factor:.2g} times the standard uncertainties of the bins"
        uses.append(Use("no", f"the data contradict the model: {reason}"))
    return combined(uses)


def _of_leaves(leaves: Sequence[str]) -> tuple[str, ...]:
    return tuple(name for name in SENSOR if leaf_of(name) in leaves)


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
