"""Figures of simulation studies."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.ground.units import shown
from tumblecal.show.figures.drawing import (
    BLUE,
    COLOURS,
    INK,
    MUTED,
    Figures,
    limit,
    name_rows,
    new_panels,
    plain_log,
    with_legend,
)
from tumblecal.show.study import point_words


Frames = Mapping[str, pl.DataFrame]


def coverage_figure(content: Mapping[str, Any], frames: Frames) -> Figure:
    """Bias, standard deviation and interval coverage of each parameter, and the distribution of the sum of squares."""
    rows, trials = frames["parameters"], content["trials"] - content["failed"]
    predicted, place = rows["predicted_sd"], range(len(rows))
    figure, panels = new_panels(5.2, 2, 2)
    bias, spread, covered, squares = panels.ravel()
    bias.errorbar(place, rows["bias"] / predicted, 2 * rows["bias_se"] / predicted, fmt="o", capsize=2, color=INK)
    spread.errorbar(place, rows["sd_over_predicted"], 2 / np.sqrt(2 * trials), fmt="o", capsize=2, color=INK)
    for level in content["levels"]:
        values = 100 * (rows[f"covered_{round(100 * level)}_stated"] - level)
        error = 200 * np.sqrt(level * (1 - level) / trials)
        covered.errorbar(place, values, error, fmt="o", capsize=2, label=f"{level:.0%} intervals")
    for panel, expected, words in (
        (bias, 0, "bias / predicted sd (2 se)"),
        (spread, 1, "sd / predicted sd"),
        (covered, 0, "covered - stated, % points"),
    ):
        limit(panel, expected)
        panel.set_ylabel(words)
        panel.set_xticks(place, rows["parameter"], rotation=90)
    histogram = np.array(content["chi2_histogram"])
    squares.stairs(histogram * len(histogram), np.linspace(0, 1, len(histogram) + 1), color=INK)
    limit(squares, 1)
    squares.set(xlabel="probability of a smaller sum of squares", ylabel="density (1 expected)")
    return with_legend(figure)


def sweep_figure(content: Mapping[str, Any], frames: Frames) -> Figure:
    """Largest bias and worst coverage at each point of the grid."""
    *others, inner = grid = content["grid"]
    units, labels = content["units"], [str(value) for value in grid[inner]]
    points = (
        frames["parameters"]
        .group_by("point", maintain_order=True)
        .agg(
            (pl.col("bias") / pl.col("predicted_sd")).abs().max(),
            pl.col("covered_95_stated").min() * 100,
        )
    )
    figure, panels = new_panels(3.2, 1, 2)
    for start in range(0, len(points), len(labels)):
        values, part = content["points"][start]["values"], points[start : start + len(labels)]
        name = ", ".join(point_words(key, values[key], units) for key in others)
        for panel, column in zip(panels[0], ("bias", "covered_95_stated"), strict=True):
            panel.plot(labels, part[column], "o-", label=name or None)
            panel.set_xlabel(f"{inner}, {units[inner]}" if inner in units else inner)
    panels[0, 0].set_ylabel("largest bias / predicted sd")
    panels[0, 1].set_ylabel("worst coverage of 95 % intervals, %")
    limit(panels[0, 1], 95)
    return with_legend(figure, 3)


def convergence_figure(content: Mapping[str, Any], frames: Frames) -> Figure:
    """Rms error of the worst parameter of each kind against the number of data sets, and the consistency."""
    leaf = pl.col("parameter").str.replace("_[^_]*$", "")
    worst = frames["errors"].group_by("method", leaf, "data_sets", maintain_order=True).agg(pl.col("rms").max())
    figure, panels = new_panels(5.2, 2, 3, 9.0)
    *panels, last = panels.ravel()
    for panel, ((name,), errors) in zip(panels, worst.group_by("parameter", maintain_order=True), strict=False):
        unit, factor = shown(UNIT_OF_LEAF[str(name)])
        for method in content["methods"]:
            chosen = errors.filter(method=method)
            panel.loglog(chosen["data_sets"], factor * chosen["rms"], label=method)
        panel.set(title=f"{name}, the worst of them", ylabel=f"rms error / {unit}", xlabel="data sets")
        plain_log(panel.yaxis)
    for method in content["methods"]:
        chosen = frames["consistency"].filter(method=method)
        last.semilogx(chosen["data_sets"], chosen["nees"] / content["nees_expected"])
    limit(last, 1)
    last.set(title="consistency: 1 expected", ylabel="NEES / expected", xlabel="data sets")
    return with_legend(figure)


def needed_figure(content: Mapping[str, Any], frames: Frames) -> Figure:
    """Data sets until the worst parameter stays below each threshold, by method; beyond the study at its right end."""
    methods, sets = content["methods"], content["data_sets"]
    worst = frames["needed"].sort("median", "p90").unique(["method", "threshold"], keep="last")
    worst = worst.with_columns(pl.col("p10", "median", "p90").clip(upper_bound=2 * sets))
    thresholds = sorted(set(worst["threshold"]), reverse=True)
    figure, panels = new_panels(2.8, 1, len(thresholds), 9.0, sharey=True)
    for panel, threshold in zip(panels[0], thresholds, strict=True):
        chosen = worst.filter(threshold=threshold)
        rows = [methods.index(method) for method in chosen["method"]]
        panel.hlines(rows, chosen["p10"], chosen["p90"], color=BLUE, lw=3)
        panel.plot(chosen["median"], rows, "o", color=INK)
        panel.axvline(sets, color=MUTED, lw=0.8)
        panel.set(xscale="log", title=f"below {threshold:g} (1, g, rad)", xlabel="data sets needed (10, 50, 90 %)")
        plain_log(panel.xaxis)
    name_rows(panels[0, 0], methods)
    return figure


def linearization_figure(content: Mapping[str, Any], frames: Frames) -> Figure:
    """Bias of the linear equations against the size of the errors, with the standard deviations of data sets."""
    sd = pl.col("parameter").replace_strict(content["predicted_sd"], return_dtype=pl.Float64)
    worst = frames["biases"].group_by("case", "path", "size", maintain_order=True).agg((pl.col("rms_bias") / sd).max())
    limits = {1 / np.sqrt(sets): f"sets: {sets}" for sets in content["study"].get("data_sets", [1, 100])}
    cases = worst.partition_by("case", maintain_order=True)
    figure, panels = new_panels(2.9, 1, len(cases), 9.0, sharey=True)
    for panel, of_case in zip(panels[0], cases, strict=True):
        for chosen, colour in zip(of_case.partition_by("path", maintain_order=True), COLOURS, strict=False):
            size, ratio = 1e3 * chosen["size"].to_numpy(), chosen["rms_bias"].to_numpy()
            if np.all(ratio > 1e-8):
                panel.loglog(size, ratio, "o", color=colour, label=chosen["path"][0])
                panel.loglog(size, ratio[0] * (size / size[0]) ** 2, "--", lw=0.8, color=colour)
        for value in limits:
            limit(panel, value)
        panel.set(title=f"{of_case['case'][0]} errors", xlabel="sd of the errors, mrad")
    panels[0, 0].set_ylabel("worst rms bias / sd of one set")
    panels[0, 0].legend(title="dashed: slope 2")
    panels[0, -1].secondary_yaxis("right").set_yticks(list(limits), list(limits.values()))
    return figure


def power_figure(content: Mapping[str, Any], frames: Frames) -> Figure:
    """Share of the runs in which an effect is detected and named, against its size."""
    rates = frames["rates"]
    smallest = rates.filter(pl.col("size") > 0)["size"].min()
    figure, panels = new_panels(3.0, 1, 2, sharey=True)
    for panel, column, title in zip(panels[0], ("detected", "named"), ("detected", "named rightly"), strict=True):
        for (effect, unit), chosen in rates.group_by("effect", "unit", maintain_order=True):
            panel.plot(chosen["size"], chosen[column], "o-", label=f"{effect}, {unit}")
        panel.set(title=title, xlabel="size, in the effect's unit")
        panel.set_xscale("symlog", linthresh=smallest)
    panels[0, 0].set_ylabel("share of runs")
    return with_legend(figure, 3)


# By kind of study and file.
FIGURES: Mapping[str, Figures] = {
    "coverage": {"coverage.svg": coverage_figure},
    "sweep": {"sweep.svg": sweep_figure},
    "convergence": {"convergence.svg": convergence_figure, "data_sets_needed.svg": needed_figure},
    "linearization": {"linearization.svg": linearization_figure},
    "power": {"power.svg": power_figure},
}
