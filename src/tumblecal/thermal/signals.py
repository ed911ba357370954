"""Signals in a table of bins that are no function of temperature: hysteresis, rate, lag of the thermometer, drift with time."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.ground.axes import AXES
from tumblecal.recordings.thermal.thermal_table import ThermalTable
from tumblecal.thermal.hysteresis import FORMS, forms_of


NAMES = (*FORMS, "temperature_rate", "temperature_lag", "drift")


@dataclass(frozen=True)
class Signals:
    """Signals of one kind: `values` (orders, components, rows, 3), g for a coefficient of 1; `scale`: a typical coefficient."""

    name: str
    components: tuple[str, ...]
    unit: str
    values: Float[np.ndarray, "orders components rows 3"]
    scale: float = 1e-3

    def up_to(self, order: int) -> Float[np.ndarray, "signals rows 3"]:
        """The signals of the first orders, one after another."""
        chosen = self.values[:order]
        return chosen.reshape(-1, *chosen.shape[2:])

    def names(self, order: int) -> tuple[str, ...]:
        """Names of the components of the first orders."""
        several = len(self.values) > 1
        return tuple(
            f"{component}{number if several else ''}" for number in range(1, order + 1) for component in self.components
        )


def of_table(table: ThermalTable) -> tuple[Signals, ...]:
    """Hysteresis, rate and drift, as far as the table can show them."""
    found = [_on_axes(name, "g", shapes) for name, shapes in forms_of(table).items()]
    if _varies(table.rate_degc_per_s):
        found.append(_on_axes("temperature_rate", "g/(degC/s)", [table.rate_degc_per_s], scale=0.1))
    # Time since the first row of each clock, h.
    hours = np.zeros(len(table))
    for clock in set(table.clock):
        here = np.array([label == clock for label in table.clock])
        hours[here] = (table.time_s[here] - np.min(table.time_s[here])) / 3600
    if _varies(hours):
        found.append(_on_axes("drift", "g/h", [hours]))
    return tuple(found)


def kind(name: str) -> str:
    """The kind of a signal: one for all forms of hysteresis."""
    return "hysteresis" if name in FORMS else name


def lag(table: ThermalTable, slope: Float[np.ndarray, "rows 3"]) -> Signals | None:
    """A delay of the sensor by some seconds: readings follow the temperature that the thermometer showed before.

    **Arguments:**

    - `slope`: derivative of the readings by the temperature, g/degC.
    """
    if not _varies(table.rate_degc_per_s):
        return None
    signal = -table.rate_degc_per_s[:, None] * slope
    return Signals("temperature_lag", ("",), "s", signal[None, None], scale=10.0)


def _on_axes(name: str, unit: str, shapes: list[np.ndarray], scale: float = 1e-3) -> Signals:
    values = np.zeros((len(shapes), 3, len(shapes[0]), 3))
    for order, shape in enumerate(shapes):
        for axis in range(3):
            values[order, axis, :, axis] = shape
    return Signals(name, AXES, unit, values, scale)


def _varies(column: np.ndarray) -> bool:
    return bool(np.ptp(column) > 1e-9 * max(1.0, float(np.max(np.abs(column)))))


def half_widths(signals: Signals, order: int, coefficients: Float[np.ndarray, " signals"]) -> Float[np.ndarray, "3"]:
    """The largest size of some signals on each axis over the rows, g: half of the width between branches for hysteresis."""
    total = np.tensordot(coefficients, signals.up_to(order), 1)
    return np.max(np.abs(total), axis=0)
