"""Figures of a temperature calibration: parameters, residuals and branches over temperature, the course of the temperature, and
errors of held-out rows."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.ground.axes import AXES
from tumblecal.ground.units import shown
from tumblecal.report.drawing import AXIS_COLOUR, BAND, INK, MUTED, OUTSIDE, new_figure
from tumblecal.thermal.estimates import (
    after_correction,
    before_correction,
    bin_estimates,
    cells_of,
    known_at_reference,
    leaves,
    parameters_at,
    sd_at,
    varying,
)
from tumblecal.thermal.result import ThermalResult


_DEGC = "temperature / °C"
# A band of 95 % of a normal distribution.
_COVERAGE = 1.96
_POINTS = 121
# Marks of rising and falling temperature, and of soaks that were not reached by a change.
_MARKS, _FILLED = {1: "o", -1: "o", 0: "s"}, {1: True, 0: True, -1: False}
_WORDS = {1: "rising", -1: "falling", 0: "constant"}
_DIRECTION_COLOUR = {1: OUTSIDE, -1: "#0072B2", 0: INK}
_OF_COMPONENT = {"21": "x", "31": "y", "32": "z"}
# More held-out parts than these have no bars.
_MOST_BARS = 12


def parameter_figure(result: ThermalResult) -> Figure:
    """A panel for each parameter that follows temperature: curve, band, and the estimates of the bins by direction."""
    degc = np.linspace(*result.table.range_degc, _POINTS)
    values, sd, bins = parameters_at(result, degc), sd_at(result, degc), bin_estimates(result)
    rows = leaves(result)
    figure = new_figure(7.5, 2.1 * len(rows) + 0.6)
    panels = figure.subplots(len(rows), 3, sharex=True, squeeze=False)
    for panel in panels.ravel():
        panel.set_visible(False)
    for name in varying(result):
        k, leaf = SENSOR.index(name), leaf_of(name)
        unit, factor = shown(GROUPS[leaf][1])
        panel = panels[rows.index(leaf), k % 3]
        panel.set_visible(True)
        colour = _colour(name)
        band = _COVERAGE * sd[:, k] * factor
        panel.fill_between(degc, values[:, k] * factor - band, values[:, k] * factor + band, color=BAND, lw=0)
        panel.plot(degc, values[:, k] * factor, "-", color=colour, lw=1.4)
        _points(panel, bins.degc, bins.values[:, k] * factor, bins.direction, colour)
        panel.axvline(result.reference_degc, color=MUTED, lw=0.7, ls=":")
        change = "" if known_at_reference(result, name) else "change of "
        panel.set_title(f"{change}{name} / {unit}", loc="left")
        panel.locator_params(axis="y", nbins=5)
        if leaf == rows[-1]:
            panel.set_xlabel(_DEGC)
    _legend(figure, bins.direction)
    return figure


def residual_figure(result: ThermalResult) -> Figure:
    """Residuals by axis with the parameters at the reference (left) and at the temperature (right), over the noise."""
    table = result.table
    figure = new_figure(7.5, 5.0)
    panels = figure.subplots(3, 2, sharex=True)
    direction = np.asarray(table.reached_by)
    sides = [1e3 * before_correction(result), 1e3 * after_correction(result)]
    noise = 2e3 * np.median(table.sd, axis=0) * result.noise_factor
    reach = [1.1 * max(float(np.max(np.abs(side))), float(np.max(noise))) for side in sides]
    for row, axis in enumerate(AXES):
        for column, values in enumerate(sides):
            panel = panels[row, column]
            panel.axhspan(-noise[row], noise[row], color=BAND, zorder=0)
            panel.axhline(0, color=INK, lw=0.6)
            _points(panel, table.temperature_degc, values[:, row], direction, AXIS_COLOUR[axis])
            panel.set_ylim(-reach[column], reach[column])
            panel.locator_params(axis="y", nbins=5)
        panels[row, 0].set_ylabel(f"{axis}: measured -\npredicted / mg")
    times = reach[0] / reach[1]
    panels[0, 0].set_title("before: at the reference", loc="left")
    larger = f" (scale {times:.2g} times larger)" if times > 1.5 else ""
    panels[0, 1].set_title(f"after: at the temperature{larger}", loc="left")
    for panel in panels[2]:
        panel.set_xlabel(_DEGC)
    _legend(figure, direction)
    return figure


def hysteresis_figure(result: ThermalResult) -> Figure:
    """The loop of each axis: residuals after the correction, means over attitudes, by direction, and the fitted branches."""
    table = result.table
    after, cells, direction = 1e3 * after_correction(result), cells_of(table.temperature_degc), table.reached_by
    place = [signal.name for signal in result.signals].index("hysteresis")
    (given, order), found = result.choice.model.signals[place], result.signals[place]
    fitted = 1e3 * np.tensordot(found.coefficients, given.up_to(order), 1)
    figure = new_figure(7.5, 2.6)
    panels = figure.subplots(1, 3, sharey=True)
    degc, signs, means, lines = [], [], [], []
    for cell, sign in sorted({*zip(cells.tolist(), direction.tolist(), strict=True)}):
        rows = (cells == cell) & (direction == sign)
        degc.append(float(np.mean(table.temperature_degc[rows])))
        signs.append(sign)
        means.append(np.mean(after[rows], axis=0))
        lines.append(np.mean(fitted[rows], axis=0))
    places, turned = np.array(degc), np.array(signs)
    for k, axis in enumerate(AXES):
        panel = panels[k]
        panel.axhline(0, color=INK, lw=0.6)
        for sign, style in ((1, "-"), (-1, "--")):
            here = turned == sign
            panel.plot(places[here], np.array(lines)[here, k], style, color=AXIS_COLOUR[axis], lw=1.4)
        _points(panel, places, np.array(means)[:, k], turned, AXIS_COLOUR[axis])
        panel.set_title(axis, loc="left")
        panel.set_xlabel(_DEGC)
    panels[0].set_ylabel("residual of the bias / mg")
    _legend(figure, turned)
    return figure


def held_out_figure(result: ThermalResult) -> Figure:
    """Errors of held-out rows without and with the dependence on temperature, and the noise of these rows."""
    parts = result.held_out[:_MOST_BARS]
    figure = new_figure(7.5, 0.55 * len(parts) + 1.0)
    panel = figure.subplots()
    height = np.arange(len(parts))
    for shift, colour, words, sizes in (
        (-0.2, MUTED, "parameters at the reference", [part.before_mg for part in parts]),
        (0.2, AXIS_COLOUR["x"], "parameters at the temperature", [part.after_mg for part in parts]),
    ):
        bars = panel.barh(height + shift, sizes, height=0.36, color=colour, label=words)
        panel.bar_label(bars, [f"{size:.3g}" for size in sizes], padding=3, fontsize=7.5)
    for k, part in enumerate(parts):
        panel.plot([part.noise_mg] * 2, [k - 0.42, k + 0.42], color=INK, lw=1.6, label="noise" if k == 0 else None)
    panel.set_yticks(height, [_label(part.label) for part in parts])
    panel.invert_yaxis()
    panel.grid(axis="y", visible=False)
    panel.set_xlim(0, 1.12 * max(part.before_mg for part in parts))
    panel.set_xlabel("error on held-out rows, root mean square / mg")
    figure.legend(loc="outside upper left", ncols=3, fontsize=7)
    return figure


def course_figure(result: ThermalResult) -> Figure:
    """The temperature of the rows over time, from the first row of each clock."""
    table = result.table
    figure = new_figure(7.5, 2.4)
    panel = figure.subplots()
    hours = np.zeros(len(table))
    for clock in dict.fromkeys(table.clock):
        here = np.flatnonzero([label == clock for label in table.clock])
        hours[here] = (table.time_s[here] - np.min(table.time_s[here])) / 3600
        order = here[np.argsort(hours[here])]
        panel.plot(hours[order], table.temperature_degc[order], "-", color=MUTED, lw=0.6, zorder=1)
    for sign in _signs(table.direction):
        here = table.direction == sign
        words = "soak" if sign == 0 else _WORDS[sign]
        panel.plot(hours[here], table.temperature_degc[here], "o", ms=3, color=_DIRECTION_COLOUR[sign], label=words)
    panel.set_xlabel("time since the first row of the recording / h")
    panel.set_ylabel(_DEGC)
    figure.legend(loc="outside upper left", ncols=3, fontsize=7)
    return figure


def small_figure(result: ThermalResult) -> Figure:
    """For the first screen: changes of the biases over temperature, with the bins."""
    figure = new_figure(3.9, 1.75)
    panel = figure.subplots()
    degc = np.linspace(*result.table.range_degc, _POINTS)
    names = [name for name in varying(result) if leaf_of(name) == "bias"] or varying(result)[:3]
    bins, at_reference = bin_estimates(result), parameters_at(result, np.array([result.reference_degc]))
    curves = parameters_at(result, degc) - at_reference
    unit, factor = shown(GROUPS[leaf_of(names[0])][1])
    for name in names:
        k = SENSOR.index(name)
        panel.plot(degc, factor * curves[:, k], "-", color=_colour(name), label=name)
        points = factor * (bins.values - at_reference)[:, k]
        panel.plot(bins.degc, points, "o", ms=2, mfc="none", mew=0.6, color=_colour(name))
    panel.tick_params(labelsize=7.5, length=2)
    panel.set_xlabel(_DEGC, fontsize=8)
    panel.set_ylabel(f"change / {unit}", fontsize=8)
    figure.legend(loc="outside upper left", ncols=3, fontsize=7)
    return figure


def _points(panel: Axes, across: np.ndarray, values: np.ndarray, direction: np.ndarray, colour: str) -> None:
    """Dots for rising, rings for falling, squares for constant temperature."""
    for sign in _signs(direction):
        here = direction == sign
        face = colour if _FILLED[sign] else "none"
        panel.plot(across[here], values[here], _MARKS[sign], ms=3, color=colour, mfc=face, mew=0.7, ls="none")


def _legend(figure: Figure, direction: np.ndarray) -> None:
    panel = figure.axes[0]
    for sign in _signs(direction):
        face = INK if _FILLED[sign] else "none"
        words = f"{_WORDS[sign]} temperature"
        panel.plot([], [], _MARKS[sign], ms=3, color=INK, mfc=face, mew=0.7, ls="none", label=words)
    figure.legend(*panel.get_legend_handles_labels(), loc="outside upper left", ncols=3, fontsize=7)


def _signs(direction: np.ndarray) -> list[int]:
    """The directions that occur: rising, falling, constant."""
    return [sign for sign in (1, -1, 0) if np.any(direction == sign)]


def _colour(name: str) -> str:
    component = name.partition("_")[2]
    return AXIS_COLOUR[_OF_COMPONENT.get(component, component)]


def _label(words: str) -> str:
    """Words of held-out rows in two lines."""
    return words.replace(", ", "\n").replace(" degC", " °C")
