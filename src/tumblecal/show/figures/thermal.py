"""Figures of a temperature calibration: parameters, residuals and branches over temperature, the course of the temperature, and
errors of held-out rows."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.ground.units import shown
from tumblecal.show.figures.drawing import (
    AXIS_COLOUR,
    BAND,
    BLUE,
    CARD,
    COLOURS,
    INK,
    MUTED,
    OUTSIDE,
    Figures,
    marks,
    new_panel,
    new_panels,
    new_rows,
    with_legend,
)
from tumblecal.show.figures.residuals import Column, Group, residual_figure
from tumblecal.thermal.estimates import (
    after_correction,
    before_correction,
    bin_estimates,
    cells_of,
    known_at_reference,
    parameters_at,
    sd_at,
    varying,
)
from tumblecal.thermal.result import ThermalResult


_DEGC = "temperature / °C"
# A band of 95 % of a normal distribution.
_COVERAGE = 1.96
_POINTS = 121
# Words, mark, ring and colour of a direction of change; soaks that no change reached are constant.
_DIRECTIONS = {1: ("rising", "o", False, OUTSIDE), -1: ("falling", "o", True, BLUE), 0: ("constant", "s", False, INK)}
# More held-out parts than these have no bars.
_MOST_BARS = 12


def parameter_figure(result: ThermalResult) -> Figure | None:
    """A panel for each parameter that follows temperature: curve, band, and the estimates of the bins by direction; None if
    there are none."""
    names = sorted(varying(result), key=SENSOR.index)
    if not names:
        return None
    degc, bins = np.linspace(*result.table.range_degc, _POINTS), bin_estimates(result)
    values, half = parameters_at(result, degc), _COVERAGE * sd_at(result, degc)
    rows = -(-len(names) // 3)
    figure, panels = new_panels(2.1 * rows + 0.6, rows, 3, sharex=True)
    for name, panel in zip(names, panels.ravel(), strict=False):
        k = SENSOR.index(name)
        unit, factor = shown(GROUPS[leaf_of(name)][1])
        middle, band = factor * values[:, k], factor * half[:, k]
        panel.fill_between(degc, middle - band, middle + band, color=BAND, lw=0)
        panel.plot(degc, middle, color=COLOURS[k % 3])
        _points(panel, bins.degc, factor * bins.values[:, k], bins.direction, COLOURS[k % 3])
        panel.axvline(result.reference_degc, color=MUTED, lw=0.7, ls=":")
        panel.set_title(f"{'' if known_at_reference(result, name) else 'change of '}{name} / {unit}")
    for panel in panels.ravel()[len(names) :]:
        panel.set_visible(False)
    for panel in panels[-1]:
        panel.set_xlabel(_DEGC)
    return with_legend(figure)


def residuals_figure(result: ThermalResult) -> Figure:
    """Residuals by axis with the parameters at the reference (left) and at the temperature (right), over the noise."""
    table, direction = result.table, np.asarray(result.table.reached_by)
    noise = 2e3 * np.median(table.sd, axis=0) * result.noise_factor
    sides = 1e3 * np.array([before_correction(result), after_correction(result)])
    before, after = 1.1 * np.maximum(np.max(np.abs(sides), axis=(1, 2)), np.max(noise))
    larger = f" (scale {before / after:.2g} times larger)" if before > 1.5 * after else ""
    titles = "before: at the reference", f"after: at the temperature{larger}"
    columns = []
    for title, values in zip(titles, sides, strict=True):
        groups = [
            Group(f"{words} temperature", values, here, marker, "", ring)
            for here, words, marker, ring, _ in _by_direction(direction)
        ]
        columns.append(Column(_DEGC, table.temperature_degc, groups, title))
    return residual_figure(columns, noise, np.tile([before, after], (3, 1)))


def hysteresis_figure(result: ThermalResult) -> Figure | None:
    """The loop of each axis: residuals after the correction, means over attitudes, by direction, and the fitted branches;
    None without hysteresis."""
    names = [signal.name for signal in result.signals]
    if "hysteresis" not in names:
        return None
    place, table = names.index("hysteresis"), result.table
    given, order = result.choice.model.signals[place]
    fitted = 1e3 * np.tensordot([*result.signals[place].coefficients.values()], given.up_to(order), 1)
    cells, direction = cells_of(table.temperature_degc), np.asarray(table.reached_by)
    loops = sorted({*zip(cells.tolist(), direction.tolist(), strict=True)})
    degc, means, lines, signs = (
        np.array([np.mean(values[(cells == cell) & (direction == sign)], axis=0) for cell, sign in loops])
        for values in (table.temperature_degc, 1e3 * after_correction(result), fitted, direction)
    )
    figure, panels = new_panels(2.6, 1, 3, sharey=True)
    for k, (axis, colour) in enumerate(AXIS_COLOUR.items()):
        panel = panels[0, k]
        panel.axhline(0, color=INK, lw=0.6)
        for sign, style in ((1, "-"), (-1, "--")):
            panel.plot(degc[signs == sign], lines[signs == sign, k], style, color=colour)
        _points(panel, degc, means[:, k], signs, colour)
        panel.set(title=axis, xlabel=_DEGC)
    panels[0, 0].set_ylabel("residual of the bias / mg")
    return with_legend(figure)


def held_out_figure(result: ThermalResult) -> Figure | None:
    """Errors of held-out rows without and with the dependence on temperature, and the noise of these rows; None without any."""
    parts = result.held_out[:_MOST_BARS]
    if not parts:
        return None
    names = [part.label.replace(", ", "\n").replace(" degC", " °C") for part in parts]
    figure, panel = new_rows(names, 0.55, "error on held-out rows, root mean square / mg")
    rows = np.arange(len(parts))
    for shift, colour, words, sizes in (
        (-0.2, MUTED, "parameters at the reference", [part.before_mg for part in parts]),
        (0.2, BLUE, "parameters at the temperature", [part.after_mg for part in parts]),
    ):
        panel.barh(rows + shift, sizes, 0.36, color=colour, label=words)
    panel.vlines([part.noise_mg for part in parts], rows - 0.42, rows + 0.42, color=INK, lw=1.6, label="noise")
    return with_legend(figure)


def course_figure(result: ThermalResult) -> Figure:
    """The temperature of the rows over time, from the first row of each clock."""
    table = result.table
    figure, panel = new_panel(2.4, xlabel="time since the first row of the recording / h", ylabel=_DEGC)
    starts: dict[str, float] = {}
    for clock, time in zip(table.clock, table.time_s.tolist(), strict=True):
        starts[clock] = min(time, starts.get(clock, time))
    hours = (table.time_s - [starts[clock] for clock in table.clock]) / 3600
    for here, words, _, _, colour in _by_direction(table.direction):
        marks(panel, hours[here], table.temperature_degc[here], colour, words)
    return with_legend(figure)


def small_figure(result: ThermalResult) -> Figure:
    """For the first screen: changes of the biases over temperature, with the bins."""
    degc, bins = np.linspace(*result.table.range_degc, _POINTS), bin_estimates(result)
    names = [name for name in varying(result) if leaf_of(name) == "bias"] or varying(result)[:3]
    at_reference = parameters_at(result, np.array([result.reference_degc]))
    curves, points = parameters_at(result, degc) - at_reference, bins.values - at_reference
    unit, factor = shown(GROUPS[leaf_of(names[0])][1])
    figure, panel = new_panel(1.75, CARD, xlabel=_DEGC, ylabel=f"change / {unit}")
    for name in names:
        k = SENSOR.index(name)
        panel.plot(degc, factor * curves[:, k], color=COLOURS[k % 3], label=name)
        marks(panel, bins.degc, factor * points[:, k], COLOURS[k % 3], ring=True)
    return with_legend(figure)


def _points(panel: Axes, across: np.ndarray, values: np.ndarray, direction: np.ndarray, colour: str) -> None:
    """Dots for rising, rings for falling, squares for constant temperature."""
    for here, words, marker, ring, _ in _by_direction(direction):
        marks(panel, across[here], values[here], colour, marker=marker, ring=ring)
        marks(panel, [], [], INK, f"{words} temperature", marker=marker, ring=ring)


def _by_direction(direction: np.ndarray) -> list[tuple]:
    """The rows of each direction that occurs, with its look."""
    return [(direction == sign, *look) for sign, look in _DIRECTIONS.items() if sign in direction]


FIGURES: Figures = {
    "changes": small_figure,
    "parameters": parameter_figure,
    "residuals": residuals_figure,
    "hysteresis": hysteresis_figure,
    "held_out": held_out_figure,
    "course": course_figure,
}
