"""Panels of residuals: a row for each axis, a column for each variable, over the band of the noise."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.data import PositionSet
from tumblecal.ground.axes import AXES
from tumblecal.show.figures.drawing import (
    AXIS_COLOUR,
    INK,
    WIDTH,
    OfAxes,
    Shown,
    Values,
    angle_ticks,
    marks,
    new_panels,
    noise_band,
    with_legend,
)


# More pitch settings than these share one panel.
_MOST_PANELS = 8


class Group(NamedTuple):
    """Residuals with one mark.

    - `words`: in the legend. `values`: mg. `shown`: the positions that are drawn.
    - `colour`: "" for that of the axis. `bars`: half lengths of bars, mg.
    """

    words: str
    values: OfAxes
    shown: Shown
    marker: str = "o"
    colour: str = ""
    ring: bool = False
    bars: OfAxes | None = None


class Column(NamedTuple):
    """A column of panels: the variable with its unit, its values (positions), or (positions, 3) for one of each axis."""

    variable: str
    across: np.ndarray
    groups: Sequence[Group]
    title: str = ""


def angle_columns(data: PositionSet, groups: Sequence[Group]) -> list[Column]:
    """Residuals against the spindle angle, a column for each pitch setting, or one if they are many."""
    variable, alpha, pitch = "alpha / °", data.alpha_deg, data.pitch_setting_deg
    settings = np.unique(pitch)
    if len(settings) > _MOST_PANELS:
        return [Column(variable, alpha, groups, f"all {len(settings)} pitch settings")]
    return [
        Column(
            variable,
            alpha,
            [group._replace(shown=group.shown & (pitch == setting)) for group in groups],
            f"beta {setting:g}°",
        )
        for setting in settings
    ]


def residual_figure(
    columns: Sequence[Column],
    noise: Float[np.ndarray, "3"],
    reach: Float[np.ndarray, "3 #columns"],
    words: str = "2 standard deviations of the noise",
) -> Figure:
    """The panels; residuals beyond the scale are diamonds at its edge.

    **Arguments:**

    - `noise`: half of the band of each axis, mg; `words`: what it is.
    - `reach`: half the height of the panels of each axis, mg; of each column, or the same for all.
    """
    sharex = "all" if len({column.variable for column in columns}) == 1 else "col"
    sharey = "row" if reach.shape[1] == 1 else "none"
    width = max(WIDTH, 1.9 * len(columns) + 1.2)
    figure, panels = new_panels(5.2, 3, len(columns), width, sharex=sharex, sharey=sharey)
    reach = np.broadcast_to(reach, panels.shape)
    for (row, place), panel in np.ndenumerate(panels):
        column = columns[place]
        across = column.across[:, row] if column.across.ndim == 2 else column.across
        noise_band(panel, float(noise[row]), words)
        for group in column.groups:
            _draw(panel, across, group, row, 0.94 * float(reach[row, place]))
        panel.set_ylim(-reach[row, place], reach[row, place])
        if column.variable.startswith("alpha"):
            angle_ticks(panel.xaxis)
    for column, above, below in zip(columns, panels[0], panels[-1], strict=True):
        above.set_title(column.title)
        below.set_xlabel(column.variable)
    for axis, panel in zip(AXES, panels[:, 0], strict=True):
        panel.set_ylabel(f"{axis}: measured -\npredicted / mg")
    for group in columns[0].groups:
        marks(panels[0, 0], [], [], group.colour or INK, group.words, marker=group.marker, ring=group.ring)
    return with_legend(figure, 5)


def _draw(panel: Axes, across: Values, group: Group, row: int, edge: float) -> None:
    colour, values, shown = group.colour or AXIS_COLOUR[AXES[row]], group.values[:, row], group.shown
    if group.bars is not None:
        bars = group.bars[shown, row]
        panel.errorbar(across[shown], values[shown], bars, fmt="none", ecolor=colour, elinewidth=0.8)
    drawn, beyond = np.clip(values, -edge, edge), np.abs(values) > edge
    for marker, here, words in ((group.marker, shown & ~beyond, None), ("D", shown & beyond, "beyond the scale")):
        if np.any(here):
            marks(panel, across[here], drawn[here], colour, words, marker=marker, ring=group.ring)
