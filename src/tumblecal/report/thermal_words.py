"""The result of a temperature calibration in words: use, improvement, orders, signals, and effects that cannot be separated."""

from collections.abc import Iterator, Sequence

import numpy as np

from tumblecal.data.sensor_parameters import SENSOR, leaf_of
from tumblecal.ground.axes import AXES
from tumblecal.ground.counted import counted
from tumblecal.ground.numbers_shown import changed
from tumblecal.recordings.thermal.thermal_table import ThermalTable
from tumblecal.thermal.model import LEAVES
from tumblecal.thermal.result import FoundSignal, ThermalResult, measured_range
from tumblecal.thermal.usual_sizes import HISTORY


_ORDERS = ("constant", "linear", "quadratic", "cubic", "of fourth order", "of fifth order")
# Residuals above this multiple of the standard uncertainties of the rows are stated.
_MUCH_NOISE = 1.2
_ABOUT = {
    "hysteresis": "half of the difference between rising and falling temperature",
    "temperature_rate": "a bias proportional to the rate of the temperature",
    "temperature_lag": "the sensor follows the thermometer with a delay",
    "drift": "a bias that changes with time",
}
_DIRECTIONS = {1: "rises", -1: "falls"}


def thermal_lines(result: ThermalResult) -> Iterator[str]:
    """The findings, one line each, the most important first."""
    yield f"Use of calibration.json: {result.calibration.use.words}"
    yield range_words(result)
    yield from improvement_lines(result)
    yield from between_lines(result)
    yield from order_lines(result)
    for signal in result.signals:
        yield f"{signal.name.capitalize().replace('_', ' ')}: {signal_words(signal)}"
    yield from separation_lines(result)
    yield from combination_lines(result)
    yield from noise_lines(result)


def range_words(result: ThermalResult) -> str:
    """Measured range and reference temperature."""
    low, high = measured_range(result.table)
    return f"Measured from {low:.4g} to {high:.4g} degC; reference temperature {result.reference_degc:.4g} degC"


def improvement_lines(result: ThermalResult) -> Iterator[str]:
    """Errors on held-out rows, without and with the dependence on temperature."""
    if result.curves is None and not result.held_out:
        return
    if not result.held_out:
        yield (
            "Improvement on held-out rows: not known, because the rest of the data would not determine the model. Record the "
            "temperature in both directions"
        )
        return
    if not _by_direction(result):
        parts, rows = counted(len(result.held_out), "part"), sum(part.rows for part in result.held_out)
        before, after, noise = _total(result)
        yield (
            f"Held-out rows, {parts} of the temperatures in turn ({counted(rows, 'row')}): error {changed(before, after)} "
            f"mg rms, noise {noise:.3g} mg"
        )
        return
    for part in result.held_out:
        yield (
            f"Held-out rows at {part.label} ({counted(part.rows, 'row')}): error "
            f"{changed(part.before_mg, part.after_mg)} mg rms, noise {part.noise_mg:.3g} mg"
        )
    if any(signal.name != "drift" for signal in result.signals):
        yield "Part of these errors is the difference between rising and falling temperature, which no correction includes"


def between_lines(result: ThermalResult) -> Iterator[str]:
    """How well other recordings predict one at temperatures outside theirs."""
    for part in result.between:
        yield (
            f"Prediction of {part.label} ({counted(part.rows, 'row')}): error {changed(part.before_mg, part.after_mg)} mg rms, "
            f"noise {part.noise_mg:.3g} mg"
        )


def _by_direction(result: ThermalResult) -> bool:
    return {part.label.partition(" ")[0] for part in result.held_out} >= {"rising", "falling"}


def total_improvement(result: ThermalResult) -> tuple[float, float, float] | None:
    """Errors of all held-out rows before and after, and their noise, mg; None without held-out rows."""
    return _total(result) if result.held_out else None


def _total(result: ThermalResult) -> tuple[float, float, float]:
    rows = np.array([part.rows for part in result.held_out], float)
    sizes = np.array([(part.before_mg, part.after_mg, part.noise_mg) for part in result.held_out])
    before, after, noise = np.sqrt(rows @ sizes**2 / np.sum(rows)).tolist()
    return before, after, noise


def order_lines(result: ThermalResult) -> Iterator[str]:
    """The order of each leaf, and the limits of the choice."""
    choice = result.choice
    followed = [f"{words} {order_words(result, leaf)}" for leaf, words in LEAVES.items() if choice.orders.get(leaf)]
    yield f"Dependence on temperature: {', '.join(followed) or 'none found'}"
    if constant := [LEAVES[leaf] for leaf in choice.highest if not choice.orders.get(leaf)]:
        yield f"No dependence found: {', '.join(constant)}"
    if stated := [LEAVES[leaf] for leaf in LEAVES if choice.forced.get(leaf) == 0]:
        yield f"Stated as constant: {', '.join(stated)}"
    if choice.dropped:
        names = ", ".join(LEAVES[leaf] for leaf in choice.dropped)
        yield f"Higher order rejected, because it does not improve the prediction of rows outside the fit: {names}"
    lowest = min((choice.highest[leaf] for leaf in choice.highest if leaf not in choice.forced), default=0)
    if 0 < lowest < 3:
        yield f"{counted(lowest + 1, 'temperature')} cannot determine an order above {lowest}"


def order_words(result: ThermalResult, leaf: str) -> str:
    """The order of a leaf: `cubic`, or `by a cubic spline with 2 knots`."""
    functions = result.choice.model.functions.get(leaf)
    if functions is None:
        return _ORDERS[0]
    if functions.knots_degc:
        return f"by a cubic spline with {counted(len(functions.knots_degc), 'knot')}"
    return _ORDERS[functions.order]


def signal_words(signal: FoundSignal) -> str:
    """A signal that no correction includes, with its largest size on each axis."""
    about = _ABOUT[signal.name]
    if signal.name == "temperature_lag":
        about += f" of {signal.coefficients[0]:.3g} +- {signal.sd[0]:.2g} s"
    budget = "U does" if signal.name == "drift" else "the uncertainty over temperature does"
    return f"{about}, at most {signal_size(signal)}. No correction includes it; {budget}"


def signal_size(signal: FoundSignal) -> str:
    """The largest size on each axis: `0.67 (x), 0.47 (y), 0.33 (z) mg`."""
    return f"{', '.join(f'{1e3 * size:.2g} ({axis})' for axis, size in zip(AXES, signal.half_width, strict=True))} mg"


def separation_lines(result: ThermalResult) -> Iterator[str]:
    """Effects that these directions and rates of the temperature do not separate, with the reason and the remedy."""
    choice, table = result.choice, result.table
    directions = [_DIRECTIONS[sign] for sign in set(table.reached_by.tolist()) - {0}]
    reasons = {0: "no file shows the direction of its change", 1: f"the temperature only {''.join(directions)}"}
    if of_temperature := choice.of_temperature:
        only = reasons.get(len(directions), "the rate is a function of the temperature")
        yield (
            f"Not separated from the dependence on temperature, because {only}: {_listed(of_temperature)}. The uncertainties "
            f"include a usual size, {100 * HISTORY:g} % of the change of each bias. To separate them, record both directions "
            "at two rates"
        )
    others = [name for name in choice.unseparated if name not in of_temperature]
    if len(others) > 1:
        yield (
            "Not separated from each other, because the temperature changed at about one rate: "
            f"{_listed(others)}. The uncertainties include their joint size at this rate. To separate them, repeat the cycle "
            "at a different rate"
        )
    yield from drift_lines(table)


def drift_lines(table: ThermalTable) -> Iterator[str]:
    """Whether drift is a part of the dependence on temperature."""
    branches: dict[str, set[str]] = {}
    for row in np.flatnonzero(table.reached_by).tolist():
        branches.setdefault(table.clock[row], set()).add(table.branch[row])
    if branches and all(len(each) == 1 for each in branches.values()):
        yield (
            "Drift cannot be separated from the dependence on temperature: no recording returns to a temperature, so time is a "
            "function of temperature. The curves include drift"
        )


def combination_lines(result: ThermalResult) -> Iterator[str]:
    """Combinations that the attitudes do not separate."""
    missing = [LEAVES[leaf] for leaf in result.choice.inseparable]
    count = counted(len(result.table.attitudes), "attitude")
    if missing and (not result.table.known_attitudes or len(missing) > 1):
        yield f"{count}: changes of {_listed(missing)} are not separated from those of the bias"
    if result.combinations:
        yield f"Combinations that the curves of the biases describe: {'; '.join(result.combinations)}"


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def noise_lines(result: ThermalResult) -> Iterator[str]:
    """The ratio of residuals and noise, if it is large."""
    if result.noise_factor > _MUCH_NOISE:
        yield (
            f"Residuals: {result.noise_factor:.2g} times the standard uncertainties of the rows. All uncertainties are "
            "multiplied by this factor"
        )


def source_words(result: ThermalResult, parameter: str) -> str:
    """Where the value of a parameter at the reference temperature comes from."""
    model = result.choice.model
    if leaf_of(parameter) in model.free:
        return "measured"
    return "stated calibration" if model.fixed else "assumed size" if model.free else "not determined"


def undetermined_words(result: ThermalResult) -> list[str]:
    """The leaves whose values at the reference temperature are not known."""
    sources = {leaf_of(name): source_words(result, name) for name in SENSOR}
    return [LEAVES[leaf] for leaf, source in sources.items() if source in ("assumed size", "not determined")]
