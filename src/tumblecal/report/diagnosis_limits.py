"""Figure of the detection limits of all effects, relative to the sizes met in practice."""

from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.units import in_words
from tumblecal.report.drawing import AXIS_COLOUR, INK, MUTED, new_figure


@dataclass
class _Row:
    """Effects that differ only in the axis: typical size, and the limits of each axis ("" if there is none)."""

    unit: str
    typical: float
    limits: dict[str, list[float | None]] = field(default_factory=dict)


def limits_figure(diagnosis: Diagnosis) -> Figure | None:
    """Detection limits divided by typical sizes, a row for each effect; None if no effect is detectable."""
    rows = _rows(diagnosis)
    sizes = [
        limit for row in rows.values() for of_axis in row.limits.values() for limit in of_axis if limit is not None
    ]
    if not sizes:
        return None
    figure = new_figure(7.5, 0.19 * len(rows) + 1.1)
    panel = figure.subplots()
    low, high = 10 ** np.floor(np.log10(min(*sizes, 0.5))), 10 ** np.ceil(np.log10(max(*sizes, 2.0)))
    edge = high * 10 ** (0.13 * np.log10(high / low))
    panel.axvspan(low, 1, color="#eef5ee", lw=0)
    panel.axvline(1, color=INK, lw=0.9)
    panel.axvline(high, color="#cccccc", lw=0.6)
    for line, row in enumerate(rows.values()):
        for axis, of_axis in row.limits.items():
            _marks(panel, line, axis, of_axis, edge)
    panel.set_xscale("log")
    panel.set_xlim(low, edge * (edge / high) ** 0.6)
    panel.set_ylim(len(rows) - 0.4, -0.6)
    panel.set_yticks(range(len(rows)), [f"{name}  ({in_words(row.typical, row.unit)})" for name, row in rows.items()])
    panel.tick_params(axis="y", labelsize=7, length=0)
    panel.set_xlabel("detection limit / typical size (in brackets)")
    _ticks(panel, low, high, edge)
    _key(panel)
    return figure


def _rows(diagnosis: Diagnosis) -> dict[str, _Row]:
    """Rows in the order of the catalogue; an undetectable coefficient is None."""
    rows: dict[str, _Row] = {}
    for id, entry in diagnosis.entries.items():
        limit, hidden = diagnosis.limits.get(id), diagnosis.invisible.get(id)
        if entry.typical <= 0 or (limit is None and hidden is None):
            continue
        family, axis = _family(id)
        row = rows.setdefault(family, _Row(entry.unit, entry.typical))
        sizes = list(limit.coefficients.values()) if limit is not None else [None]
        row.limits[axis] = [None if size is None else size / entry.typical for size in sizes]
    return rows


def _family(id: str) -> tuple[str, str]:
    """`second_order.x` -> `second_order`, `x`; `cross_coupling.x.yz` -> `cross_coupling yz`, `x`."""
    name, *parts = id.split(".")
    axis = parts[0] if parts and parts[0] in AXIS_COLOUR else ""
    return " ".join([name, *(parts[1:] if axis else parts)]), axis


def _marks(panel: Axes, line: int, axis: str, limits: list[float | None], edge: float) -> None:
    """The limits of one axis as dots, joined if there are several; undetectable ones are drawn beyond the scale."""
    colour = AXIS_COLOUR.get(axis, INK)
    height = line + {"x": -0.24, "y": 0.0, "z": 0.24}.get(axis, 0.0)
    seen = [size for size in limits if size is not None]
    if seen:
        panel.plot([min(seen), max(seen)], [height] * 2, color=colour, lw=0.8)
        panel.plot(seen, [height] * len(seen), "o", ms=3.6, color=colour)
    if len(seen) < len(limits):
        panel.plot(edge, height, "x", ms=3.6, mew=1, color=MUTED if not axis else colour, alpha=0.7)


def _ticks(panel: Axes, low: float, high: float, edge: float) -> None:
    decades = 10.0 ** np.arange(np.log10(low), np.log10(high) + 0.5)
    panel.set_xticks([*decades, edge], [*(f"{size:g}" for size in decades), "unde-\ntectable"])
    panel.minorticks_off()
    panel.set_axisbelow(True)


def _key(panel: Axes) -> None:
    handles = [
        *(panel.plot([], [], "o", ms=4, color=AXIS_COLOUR[axis], ls="none", label=f"axis {axis}")[0] for axis in "xyz"),
        panel.plot([], [], "o", ms=4, color=INK, ls="none", label="head, all axes")[0],
        panel.plot([], [], "x", ms=4, color=MUTED, ls="none", label="undetectable at any size")[0],
    ]
    panel.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=5, fontsize=7)
