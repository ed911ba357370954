"""Figures of a designed plan: positions on the sphere, uncertainties, force in use, trade-off, and the order over time."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.ground.frames import gravity_in_head, rotation_matrix
from tumblecal.plan.designed_plan import DesignedPlan
from tumblecal.show.figures.drawing import (
    AXIS_COLOUR,
    BAND,
    BLUE,
    INK,
    MUTED,
    Figures,
    in_card,
    marks,
    new_panel,
    new_panels,
    new_rows,
    plain_log,
    with_legend,
)


_MARKERS = "osD^vP"


def sphere_figure(plan: DesignedPlan) -> Figure:
    """Directions of gravity in the axes of the sensor, as two hemispheres of equal area: z up, and z down."""
    figure, panels = new_panels(3.9, 1, 2, subplot_kw={"projection": "polar"})
    # Direction of the specific force in the axes of the sensor.
    cells = plan.cells
    head = gravity_in_head(np.radians(cells.alpha_deg), np.radians(cells.beta_deg))
    angles = np.radians([plan.rig.mounts.get(mount, (0.0, 0.0, 0.0)) for mount in cells.mounts])
    x, y, z = np.array([rotation_matrix(turn) @ force for turn, force in zip(angles, head, strict=True)]).T
    for panel, sign, here in zip(panels[0], "+-", (z >= -1e-9, z < -1e-9), strict=True):
        # Lambert's azimuthal projection to the unit circle.
        _by_mounting(panel, plan, np.arctan2(y, x), np.sqrt(np.maximum(1 - np.abs(z), 0)), here)
        panel.set(rmax=1, rticks=np.sqrt(1 - np.cos(np.radians([30, 60]))), yticklabels=[])
        panel.set_thetagrids([0, 90, 180, 270], ["+x", "+y", "-x", "-y"])
        panel.set_title(f"{sign}z in the centre")
    return with_legend(figure)


def _by_mounting(
    panel: Axes, plan: DesignedPlan, across: np.ndarray, values: np.ndarray, shown: np.ndarray | bool
) -> None:
    for number, mount in enumerate(dict.fromkeys(plan.cells.mounts)):
        here = shown & (plan.cells.mounting == number)
        panel.plot(
            across[here],
            values[here],
            _MARKERS[number % len(_MARKERS)],
            ms=4.5,
            clip_on=False,
            label=f"mounting {mount}",
        )


def uncertainty_figure(plan: DesignedPlan) -> Figure:
    """Standard uncertainties before and with the plan, relative to the scales of the parameters."""
    before, after = plan.before.uncertainties, plan.after.uncertainties
    figure, panel = new_rows(after.names, 0.32, "standard uncertainty / mg, mrad, 1e-3")
    old, new = before.sd / before.scales, after.sd / after.scales
    both = np.array([old, new])
    known = both[np.isfinite(both)]
    low, high = 0.5 * np.min(known), 3.0 * np.max(known)
    rows = np.arange(len(after.names))
    panel.hlines(rows, *np.minimum(both, high), color=BAND, lw=3, zorder=0)
    marks(panel, old, rows, MUTED, "measured already" if plan.measured else "plan of the rig", ring=True)
    marks(panel, new, rows, BLUE, "this plan")
    for row in rows[np.isinf(old)]:
        panel.text(high, row, "not determined", va="center", ha="right", fontsize=7, color=MUTED)
    panel.set(xscale="log", xlim=(low, high))
    plain_log(panel.xaxis)
    return with_legend(figure)


def in_use_figure(plan: DesignedPlan) -> Figure | None:
    """Fraction of attitudes for which the corrected force is at least so precise, by axis; None if it is not determined."""
    if plan.after.uncertainties.undetermined:
        return None
    figure, panel = new_panel(2.8, xlabel="fraction of the attitudes / %", ylabel="u of the corrected\nforce / mg")
    share = 100 * np.arange(1, len(plan.after.in_use) + 1) / len(plan.after.in_use)
    for evaluated, style in ((plan.after, "-"), (plan.before, "--")):
        if not evaluated.uncertainties.undetermined:
            for (axis, colour), sizes in zip(AXIS_COLOUR.items(), evaluated.in_use.T, strict=True):
                panel.plot(share, 1e3 * np.sort(sizes), style, color=colour, label=axis)
    panel.set_ylim(bottom=0)
    return with_legend(figure)


def trade_off_figure(plan: DesignedPlan) -> Figure | None:
    """The largest standard uncertainty against the time, with common practice; None without other plans."""
    if not plan.found.traded:
        return None
    figure, panel = new_panel(3.0, xlabel="time / min", ylabel=f"criterion ({plan.found.criterion.name})")
    panel.plot(
        [each.minutes for each in plan.found.traded],
        [each.value for each in plan.found.traded],
        "o-",
        label="designed plans",
    )
    for each in plan.found.traded:
        panel.annotate(str(each.positions), (each.minutes, each.value), (0, 6), textcoords="offset points", fontsize=7)
    this = min(plan.found.traded, key=lambda each: abs(each.minutes - plan.minutes))
    panel.plot(this.minutes, this.value, "o", color=INK, ms=7, mfc="none", label="this plan")
    panel.set_ylim(bottom=0)
    return with_legend(figure)


def order_figure(plan: DesignedPlan) -> Figure:
    """Spindle angle and pitch setting over time, by mounting."""
    figure, panels = new_panels(3.2, 2, sharex=True, height_ratios=(2, 1))
    minutes, cells = plan.after.schedule.start_s / 60, plan.cells
    angles = {"alpha": cells.alpha_deg, "beta": cells.beta_deg}
    for panel, (name, angle) in zip(panels[:, 0], angles.items(), strict=True):
        panel.plot(minutes, angle, color=MUTED, lw=0.6, zorder=1)
        _by_mounting(panel, plan, minutes, angle, True)
        panel.set_ylabel(f"{name} / °")
    panels[1, 0].set_xlabel("time since the start / min")
    return with_legend(figure)


FIGURES: Figures = {
    "small": lambda plan: in_card(uncertainty_figure(plan), 2.3),
    "small_in_use": lambda plan: in_card(in_use_figure(plan), 2.0),
    "sphere": sphere_figure,
    "uncertainties": uncertainty_figure,
    "in_use": in_use_figure,
    "trade_off": trade_off_figure,
    "order": order_figure,
}
