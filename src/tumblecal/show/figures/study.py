"""Figures of simulation studies."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.ground.units import shown
from tumblecal.report.study_answers import point_words
from tumblecal.show.figures.drawing import COLOURS, INK, MUTED, Figures, new_panels
from tumblecal.show.figures.panels import limit, name_rows, plain_log, with_legend


Frames = Mapping[str, pl.DataFrame]


def coverage_figure(content: Mapping[str, Any], frames: Frames) -> Figure:
    """Bias, standard deviation and interval coverage of each parameter, and the distribution of the sum of squares."""
    rows, trials = frames["parameters"], content["trials"] - content["failed"]
    predicted = rows["predicted_sd"]
    figure, panels = new_panels(5.2, 2, 2)
    bias, spread, covered, squares = panels.ravel()
    _with_errors(bias, rows, rows["bias"] / predicted, 2 * rows["bias_se"] / predicted, 0)
    bias.set_ylabel("bias / predicted sd (2 se)")
    _with_errors(spread, rows, rows["sd_over_predicted"], 2 / np.sqrt(2 * trials), 1)
    spread.set_ylabel("sd / predicted sd")
    for level, colour in zip(content["levels"], COLOURS, strict=False):
        values = 100 * (rows[f"covered_{round(100 * level)}_stated"] - level)
        _with_errors(covered, rows, values, 200 * np.sqrt(level * (1 - level) / trials), 0, colour, f"{level:.0%}")
    covered.set_ylabel("covered - stated, % points")
    covered.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, title="interval", alignment="left")
    histogram = np.array(content["chi2_histogram"])
    squares.stairs(histogram * len(histogram), np.linspace(0, 1, len(histogram) + 1), color=INK)
    limit(squares, 1)
    squares.set(xlabel="probability of a smaller sum of squares", ylabel="density (1 expected)")
    figure.suptitle(f"{content['title']}: {trials} calibrations", fontsize=10)
    return figure


def _with_errors(
    panel: Axes,
    rows: pl.DataFrame,
    values: Any,
    errors: Any,
    expected: float,
    colour: str = INK,
    words: str | None = None,
) -> None:
    """A value with its error for each parameter, and the expected value."""
    panel.errorbar(range(len(rows)), values, errors, fmt="o", color=colour, capsize=2, label=words)
    panel.set_xticks(range(len(rows)), rows["parameter"], rotation=90)
    limit(panel, expected)


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
    """Data sets until the worst parameter stays below each threshold, by method."""
    methods, sets = content["methods"], content["data_sets"]
    # The worst parameter; numbers beyond the study are at its right end.
    needed = frames["needed"].sort("median", "p90").with_columns(pl.col("p10", "median", "p90").clip(0, 2 * sets))
    thresholds = sorted(set(needed["threshold"]), reverse=True)
    figure, panels = new_panels(2.8, 1, len(thresholds), 9.0, sharey=True)
    for panel, threshold in zip(panels[0], thresholds, strict=True):
        for row, method in enumerate(methods):
            worst = needed.filter(method=method, threshold=threshold).row(-1, named=True)
            panel.plot([worst["p10"], worst["p90"]], [row, row], lw=3)
            panel.plot(worst["median"], row, "o", color=INK)
        panel.axvline(sets, color=MUTED, lw=0.8)
        panel.set(xscale="log", title=f"below {threshold:g} (1, g, rad)", xlabel="data sets needed (10, 50, 90 %)")
        plain_log(panel.xaxis)
    name_rows(panels[0, 0], methods)
    figure.suptitle("Data sets until the worst parameter's error stays below a threshold", fontsize=10)
    return figure


def linearization_figure(content: Mapping[str, Any], frames: Frames) -> Figure:
    """Bias of the linear equations against the size of the errors, with the standard deviations of data sets."""
    sd = pl.col("parameter").replace_strict(content["predicted_sd"], return_dtype=pl.Float64)
    worst = frames["biases"].group_by("case", "path", "size", maintain_order=True).agg((pl.col("rms_bias") / sd).max())
    cases = worst["case"].unique(maintain_order=True)
    figure, panels = new_panels(2.9, 1, len(cases), 9.0, sharey=True)
    for panel, case in zip(panels[0], cases, strict=True):
        for path, colour in zip(("harmonic", "small angle"), COLOURS, strict=False):
            chosen = worst.filter(case=case, path=path)
            size, ratio = 1e3 * chosen["size"].to_numpy(), chosen["rms_bias"].to_numpy()
            if np.all(ratio > 1e-8):
                panel.loglog(size, ratio, "o", color=colour, label=path)
                panel.loglog(size, ratio[0] * (size / size[0]) ** 2, "--", lw=0.8, color=colour)
        for sets in content["study"].get("data_sets", [1, 100]):
            _sets_line(panel, sets)
        panel.set(title=f"{case} errors", xlabel="sd of the errors, mrad")
    panels[0, 0].set_ylabel("worst rms bias / sd of one set")
    panels[0, 0].legend(title="dashed: slope 2")
    return figure


def _sets_line(panel: Axes, sets: int) -> None:
    """The standard deviation of several data sets, relative to that of one, with its words above the right end."""
    sd, words = 1 / np.sqrt(sets), f"sd of {sets} set{'s' if sets > 1 else ''}"
    limit(panel, sd)
    panel.text(0.99, sd, words, transform=panel.get_yaxis_transform(), fontsize=7, color=INK, ha="right", va="bottom")


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
