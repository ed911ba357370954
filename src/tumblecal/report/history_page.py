"""`history.html`: control charts, repeatability and drift of a unit on one page."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from tumblecal.data.sensor_parameters import GROUPS, leaf_of
from tumblecal.ground.units import shown
from tumblecal.history.repeatability import FEWEST, TOGETHER, Trend, UnitHistory
from tumblecal.report.drawing import BAND, INK, MUTED, OUTSIDE, draw_each, new_figure, save
from tumblecal.report.history_list import listed
from tumblecal.report.history_words import (
    en_table,
    headline,
    interval_words,
    next_steps,
    repeatability_words,
    repeats_table,
    statements,
    trends_table,
    uncertainty_words,
)
from tumblecal.show.page import Section, inline_figure, page, write_sections
from tumblecal.show.verdict import Finding, Verdict, as_sentence


_CAPTION = (
    "Bars: expanded uncertainty at 95.45 % (k = 2 if the noise was stated, otherwise Student's t). Line: constant, with the "
    "changes that were found. Band: control limits about the mean, from the moving range, from four results on. Results beyond "
    "them are red; several charts of a stable unit have one."
)
_TESTED = (
    "Steps, drifts and single deviating results were tested against a constant with the repeatability, at a family-wise error "
    f"rate of {1 - TOGETHER:.2g} for the unit. +- is the standard uncertainty. Mount angles and pitch errors are not "
    "properties of the unit"
)
_MOST_DATES = 8


def draw_charts(folder: Path, history: UnitHistory) -> list[str]:
    """Draw the control charts; returns the names of those drawn."""
    leaves = [leaf for leaf in GROUPS if any(leaf_of(trend.name) == leaf for trend in history.trends)]
    return [*draw_each(folder, {f"history_{leaf}.svg": partial(_chart, leaf, history) for leaf in leaves}, save)]


@page
def write_history_page(path: Path, serial: str, history: UnitHistory, risk: float, charts: Sequence[str]) -> None:
    """Write the page; `charts`: names of the control charts in its folder."""
    found = statements(history)
    enough = len(history.entries) >= FEWEST
    evidence = [repeatability_words(history), _TESTED, uncertainty_words(history)]
    verdict = Verdict(
        "flagged" if found else "stable" if enough else "open",
        found[0].words if found else headline(serial, history),
        found=tuple(Finding(as_sentence(one.words)) for one in found[len(found) == 1 :]),
        evidence=tuple(f"{as_sentence(words)}." for words in evidence if words),
        next=tuple(f"{as_sentence(words)}." for words in [*next_steps(found), interval_words(history, risk)]),
    )
    write_sections(
        path,
        f"History of {serial}",
        f"{len(history.entries)} independent results{f', {history.months:.1f} months' if history.months else ''}.",
        verdict,
        [
            Section("Repeatability", tables=[repeats_table(history)]),
            Section("Control charts", figures=[inline_figure(path.parent / name, _CAPTION) for name in charts]),
            Section("Parameters", tables=[trends_table(history)]),
            Section("E_n of each result and the previous one", tables=[en_table(history)]),
            Section("Results", tables=[listed(history.entries)]),
        ],
        tone="bad" if found else "good" if enough else "open",
    )


def _chart(leaf: str, history: UnitHistory) -> Figure:
    """The control charts of one kind of parameter."""
    trends = [trend for trend in history.trends if leaf_of(trend.name) == leaf]
    figure = new_figure(7.5, 1.5 * len(trends) + 0.6)
    panels = figure.subplots(len(trends), 1, sharex=True, squeeze=False)[:, 0]
    times = [entry.when for entry in history.entries]
    dated = len(set(times)) == len(times)
    across = times if dated else list(range(1, len(times) + 1))
    for panel, trend in zip(panels, trends, strict=True):
        _draw(panel, across, trend)
    panels[-1].set_xlabel("date" if dated else "result")
    if dated:
        # Few dates, with their common part written once, so that they do not overlap.
        locator = AutoDateLocator(minticks=3, maxticks=_MOST_DATES)
        panels[-1].xaxis.set_major_locator(locator)
        panels[-1].xaxis.set_major_formatter(ConciseDateFormatter(locator))
    else:
        panels[-1].locator_params(axis="x", integer=True)
    return figure


def _draw(panel, across: list, trend: Trend) -> None:
    unit, factor = shown(trend.unit)
    values, mean = trend.values * factor, trend.mean * factor
    if trend.control > 0:
        panel.axhspan(mean - trend.control * factor, mean + trend.control * factor, color=BAND, zorder=0)
    panel.plot(across, trend.fitted * factor, color=MUTED, lw=0.8)
    panel.errorbar(across, values, yerr=trend.expanded * factor, fmt="o", ms=4, color=INK, elinewidth=0.8)
    red = np.flatnonzero(trend.outside)
    panel.plot([across[k] for k in red], values[red], "o", ms=6, color=OUTSIDE)
    panel.set_ylabel(f"{trend.name} / {unit}".replace("@", "\n@"))
