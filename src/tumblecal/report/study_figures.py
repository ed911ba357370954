"""Figures of simulation studies."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.ground.units import shown
from tumblecal.report.drawing import AXIS_COLOUR, INK, MUTED, draw_each, new_figure, save
from tumblecal.show.study import point_words


COLOURS = ("#b8b8b8", "#E69F00", "#56B4E9", "#0072B2", "#D55E00", "#CC3311", "#009E73", "#CC79A7")


def draw(kind: str, content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame], folder: Path) -> list[Path]:
    """Draw the figures of a study; returns the paths of those drawn."""
    figures = {f"{name}.svg": partial(figure_of, content, frames) for name, figure_of in _DRAWN[kind].items()}
    return [*draw_each(folder, figures, save).values()]


def _coverage(content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame]):
    rows, trials = frames["parameters"], content["trials"] - content["failed"]
    figure = new_figure(7.5, 5.2)
    (bias, spread), (covered, chi2) = figure.subplots(2, 2)
    place = np.arange(len(rows))
    z = rows["bias"].to_numpy() / rows["predicted_sd"].to_numpy()
    error = rows["bias_se"].to_numpy() / rows["predicted_sd"].to_numpy()
    look = {"fmt": "o", "ms": 3, "color": INK, "capsize": 2}
    bias.errorbar(place, z, yerr=2 * error, **look)
    bias.set_ylabel("bias / predicted sd (2 se)")
    spread.errorbar(place, rows["sd_over_predicted"], yerr=2 / np.sqrt(2 * trials), **look)
    spread.axhline(1, color=MUTED, lw=0.8)
    spread.set_ylabel("sd / predicted sd")
    for level, colour in zip(content["levels"], COLOURS[1:], strict=False):
        values = rows[f"covered_{round(100 * level)}_stated"].to_numpy() - level
        margin = 2 * np.sqrt(level * (1 - level) / trials)
        covered.errorbar(place, 100 * values, yerr=100 * margin, fmt="o", ms=3, color=colour, label=f"{level:.0%}")
    covered.axhline(0, color=MUTED, lw=0.8)
    covered.set_ylabel("covered - stated, % points")
    covered.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, title="interval", alignment="left")
    for axes in (bias, spread, covered):
        axes.set_xticks(place, rows["parameter"], rotation=90)
    histogram = np.array(content["chi2_histogram"])
    edges = np.linspace(0, 1, len(histogram) + 1)
    chi2.stairs(histogram * len(histogram), edges, color=INK)
    chi2.axhline(1, color=MUTED, lw=0.8)
    chi2.set_xlabel("probability of a smaller sum of squares")
    chi2.set_ylabel("density (1 expected)")
    figure.suptitle(f"{content['title']}: {trials} calibrations", fontsize=10)
    return figure


def _sweep(content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame]):
    rows, grid, units = frames["parameters"], content["grid"], content["units"]
    figure = new_figure(7.5, 3.2)
    axes = figure.subplots(1, 2)
    *others, inner = grid
    labels = [str(value) for value in grid[inner]]
    points = rows.group_by("point", maintain_order=True).agg(
        (pl.col("bias") / pl.col("predicted_sd")).abs().max().alias("bias"), pl.col("covered_95_stated").min()
    )
    count = len(labels)
    for start in range(0, len(points), count):
        values = content["points"][start]["values"]
        name = ", ".join(point_words(key, values[key], units) for key in others) or None
        part = points[start : start + count]
        axes[0].plot(range(count), part["bias"], "o-", ms=3, label=name)
        axes[1].plot(range(count), 100 * part["covered_95_stated"], "o-", ms=3, label=name)
    axes[0].set_ylabel("largest bias / predicted sd")
    axes[1].set_ylabel("worst coverage of 95 % intervals, %")
    axes[1].axhline(95, color=MUTED, lw=0.8)
    for panel in axes:
        panel.set_xticks(range(count), labels)
        panel.set_xlabel(f"{inner}, {units[inner]}" if inner in units else inner)
    if others:
        axes[0].legend()
    return figure


def _convergence(content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame]):
    errors, consistency = frames["errors"], frames["consistency"]
    groups = dict.fromkeys(name.rpartition("_")[0] for name in errors["parameter"].unique(maintain_order=True))
    figure = new_figure(9.0, 5.2)
    panels = figure.subplots(2, 3).ravel()
    for axes, group in zip(panels, groups, strict=False):
        unit, factor = shown(UNIT_OF_LEAF[group])
        for method, colour in zip(content["methods"], COLOURS, strict=False):
            chosen = errors.filter((pl.col("method") == method) & pl.col("parameter").str.starts_with(f"{group}_"))
            worst = chosen.group_by("data_sets", maintain_order=True).agg(pl.col("rms").max())
            axes.loglog(worst["data_sets"], factor * worst["rms"], color=colour, label=method)
        axes.set_title(f"{group}, the worst of them")
        axes.set_ylabel(f"rms error / {unit}")
        axes.set_xlabel("data sets")
        _plain_ticks(axes.yaxis)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    last = panels[5]
    for method, colour in zip(content["methods"], COLOURS, strict=False):
        chosen = consistency.filter(pl.col("method") == method)
        last.semilogx(chosen["data_sets"], chosen["nees"] / content["nees_expected"], color=colour)
    last.axhline(1, color=MUTED, lw=0.8)
    last.set_title("consistency: 1 expected")
    last.set_ylabel("NEES / expected")
    last.set_xlabel("data sets")
    return figure


def _needed(content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame]):
    needed = frames["needed"]
    thresholds = sorted(set(needed["threshold"]), reverse=True)
    figure = new_figure(9.0, 2.8)
    panels = np.atleast_1d(figure.subplots(1, len(thresholds), sharey=True))
    for axes, threshold in zip(panels, thresholds, strict=True):
        for place, method in enumerate(content["methods"]):
            rows = needed.filter((pl.col("method") == method) & (pl.col("threshold") == threshold))
            worst = rows.sort("median", "p90").row(-1, named=True)
            low, middle, high = (min(worst[name], 2.0 * content["data_sets"]) for name in ("p10", "median", "p90"))
            axes.plot([low, high], [place, place], color=COLOURS[place % len(COLOURS)], lw=3)
            axes.plot(middle, place, "o", color=INK, ms=4)
        axes.axvline(content["data_sets"], color=MUTED, lw=0.8)
        axes.set_xscale("log")
        axes.set_title(f"below {threshold:g} (1, g, rad)")
        _plain_ticks(axes.xaxis)
        axes.set_xlabel("data sets needed (10, 50, 90 %)")
    panels[0].set_yticks(range(len(content["methods"])), content["methods"])
    figure.suptitle("Data sets until the worst parameter's error stays below a threshold", fontsize=10)
    return figure


def _linearization(content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame]):
    biases = frames["biases"]
    cases = list(dict.fromkeys(biases["case"]))
    figure = new_figure(9.0, 2.9)
    panels = figure.subplots(1, len(cases), sharey=True)
    sd = content["predicted_sd"]
    biases = biases.with_columns(pl.col("parameter").replace_strict(sd, return_dtype=pl.Float64).alias("sd"))
    for axes, case in zip(panels, cases, strict=True):
        for path, colour in zip(("harmonic", "small angle"), (AXIS_COLOUR["x"], AXIS_COLOUR["y"]), strict=True):
            chosen = biases.filter((pl.col("case") == case) & (pl.col("path") == path))
            worst = chosen.group_by("size", maintain_order=True).agg((pl.col("rms_bias") / pl.col("sd")).max())
            size, ratio = 1e3 * worst["size"].to_numpy(), worst["rms_bias"].to_numpy()
            if np.all(ratio > 1e-8):
                axes.loglog(size, ratio, "o", ms=3, color=colour, label=path)
                axes.loglog(size, ratio[0] * (size / size[0]) ** 2, "--", lw=0.8, color=colour)
        for sets in content["study"].get("data_sets", [1, 100]):
            axes.axhline(1 / np.sqrt(sets), color=MUTED, lw=0.6)
            axes.annotate(
                f"sd of {sets} set{'s' if sets > 1 else ''}",
                (0.99, 1 / np.sqrt(sets)),
                xytext=(0, 1.5),
                textcoords="offset points",
                fontsize=7,
                color="#6a6a6a",
                xycoords=("axes fraction", "data"),
                ha="right",
                va="bottom",
            )
        axes.set_title(f"{case} errors")
        axes.set_xlabel("sd of the errors, mrad")
    panels[0].set_ylabel("worst rms bias / sd of one set")
    panels[0].legend(title="dashed: slope 2")
    return figure


def _plain_ticks(axis: Axis) -> None:
    """Ticks of a logarithmic axis as plain numbers, also where it is shorter than a decade."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 50 * low else (1.0,), numticks=9))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _power(content: Mapping[str, Any], frames: Mapping[str, pl.DataFrame]):
    rates = frames["rates"]
    effects = list(dict.fromkeys(rates["effect"]))
    figure = new_figure(7.5, 3.0)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, column, title in zip(panels, ("detected", "named"), ("detected", "named rightly"), strict=True):
        for effect, colour in zip(effects, COLOURS[1:], strict=False):
            chosen = rates.filter(pl.col("effect") == effect)
            axes.plot(chosen["size"], chosen[column], "o-", ms=3, color=colour, label=f"{effect}, {chosen['unit'][0]}")
        axes.set_title(title)
        axes.set_xlabel("size, in the effect's unit")
        sizes = rates["size"].to_numpy()
        axes.set_xscale("symlog", linthresh=np.min(sizes[sizes > 0], initial=1.0))
    panels[0].set_ylabel("share of runs")
    panels[0].legend()
    return figure


_DRAWN = {
    "coverage": {"coverage": _coverage},
    "sweep": {"sweep": _sweep},
    "convergence": {"convergence": _convergence, "data_sets_needed": _needed},
    "linearization": {"linearization": _linearization},
    "power": {"power": _power},
}
