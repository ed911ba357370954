"""Figures of a designed plan: positions on the sphere, uncertainties, force in use, trade-off, and the order over time."""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from tumblecal.design.plan import DesignedPlan
from tumblecal.ground.axes import AXES
from tumblecal.ground.frames import gravity_in_head, rotation_matrix
from tumblecal.report.drawing import AXIS_COLOUR, BAND, INK, MUTED, new_figure


# Colours of mountings, distinguishable for colour-blind readers (Okabe and Ito 2008).
_MOUNTING = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_MARKS = "osD^vP"


def figures_of(plan: DesignedPlan) -> Iterator[tuple[str, Callable[[DesignedPlan], Figure]]]:
    """The functions that draw the figures of a plan, by name."""
    yield "sphere", sphere_figure
    yield "uncertainties", uncertainty_figure
    if not plan.after.uncertainties.undetermined:
        yield "in_use", in_use_figure
    if plan.traded:
        yield "trade_off", trade_off_figure
    yield "order", order_figure


def sphere_figure(plan: DesignedPlan) -> Figure:
    """Directions of gravity in the axes of the sensor, as two hemispheres of equal area: z up, and z down."""
    figure = new_figure(7.5, 3.9)
    panels = figure.subplots(1, 2)
    force, mounting = _force(plan), plan.cells.mounting
    for panel, up in zip(panels, (True, False), strict=True):
        _hemisphere(panel, up=up)
        for number, mount in enumerate(dict.fromkeys(plan.cells.mounts)):
            here = (mounting == number) & ((force[:, 2] >= -1e-9) == up)
            across = _equal_area(force[here])
            style = {"color": _colour(number), "ls": "none", "ms": 5}
            panel.plot(*across.T, _MARKS[number % len(_MARKS)], label=f"mounting {mount}" if up else None, **style)
    figure.legend(loc="outside upper left", ncols=4, fontsize=7)
    return figure


def _hemisphere(panel: Axes, *, up: bool) -> None:
    angle = np.linspace(0, 2 * np.pi, 181)
    for polar in (30, 60, 90):
        radius = np.sqrt(2) * np.sin(np.radians(polar / 2))
        panel.plot(radius * np.cos(angle), radius * np.sin(angle), color=MUTED if polar < 90 else INK, lw=0.5)
    for direction in np.radians(np.arange(0, 360, 45)):
        panel.plot([0, np.cos(direction)], [0, np.sin(direction)], color=MUTED, lw=0.4)
    panel.text(1.05, 0, "+x", va="center")
    panel.text(0, 1.05, "+y", ha="center")
    panel.set_title(f"{'+' if up else '-'}z in the centre", loc="left")
    panel.set_aspect("equal")
    panel.set_xlim(-1.15, 1.3)
    panel.set_ylim(-1.1, 1.25)
    panel.axis("off")


def _equal_area(force: Float[np.ndarray, "positions 3"]) -> Float[np.ndarray, "positions 2"]:
    """Lambert's azimuthal equal-area projection of a hemisphere to the unit circle."""
    return force[:, :2] / np.sqrt(1 + np.abs(force[:, 2:]))


def uncertainty_figure(plan: DesignedPlan) -> Figure:
    """Standard uncertainties before and with the plan, relative to the scales of the parameters."""
    figure = new_figure(7.5, 0.32 * len(plan.after.uncertainties.names) + 0.9)
    _uncertainties(figure.subplots(), plan)
    return figure


def small_figure(plan: DesignedPlan) -> Figure:
    """The same for the first screen."""
    figure = new_figure(3.9, 2.3)
    _uncertainties(figure.subplots(), plan, size=7)
    return figure


def _uncertainties(panel: Axes, plan: DesignedPlan, size: float = 8) -> None:
    before, after = plan.before.uncertainties, plan.after.uncertainties
    place = np.arange(len(after.names))
    old, new = before.sd / before.scales, after.sd / after.scales
    known = np.concatenate([new, old])[np.isfinite(np.concatenate([new, old]))]
    low, high = 0.5 * float(np.min(known)), 5.0 * float(np.max(known))
    panel.hlines(place, np.minimum(new, high), np.minimum(old, high), color=BAND, lw=3, zorder=0)
    panel.plot(
        old, place, "o", mfc="none", color=MUTED, ms=5, label="measured already" if plan.measured else "plan of the rig"
    )
    panel.plot(new, place, "o", color=AXIS_COLOUR["x"], ms=5, label="this plan")
    for k in np.flatnonzero(np.isinf(old)).tolist():
        panel.text(high, k, "not determined", va="center", ha="right", fontsize=size - 1, color=MUTED)
    panel.set_yticks(place, list(after.names), fontsize=size)
    panel.invert_yaxis()
    panel.set_xscale("log")
    panel.set_xlim(low, high if np.any(np.isinf([old, new])) else None)
    panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.tick_params(axis="x", labelsize=size)
    panel.set_xlabel("standard uncertainty / mg, mrad, 1e-3", fontsize=size)
    panel.legend(fontsize=size - 0.5, loc="best")


def in_use_figure(plan: DesignedPlan) -> Figure:
    """Fraction of attitudes for which the corrected force is at least so precise, by axis."""
    figure = new_figure(7.5, 2.8)
    _in_use(figure, plan)
    return figure


def small_use_figure(plan: DesignedPlan) -> Figure:
    """The same for the first screen."""
    figure = new_figure(3.9, 2.0)
    _in_use(figure, plan, size=7)
    return figure


def _in_use(figure: Figure, plan: DesignedPlan, size: float = 9) -> None:
    panel = figure.subplots()
    share = np.arange(1, len(plan.after.in_use) + 1) / len(plan.after.in_use)
    for k, axis in enumerate(AXES):
        panel.plot(100 * share, 1e3 * np.sort(plan.after.in_use[:, k]), color=AXIS_COLOUR[axis], label=axis)
        if not plan.before.uncertainties.undetermined:
            panel.plot(100 * share, 1e3 * np.sort(plan.before.in_use[:, k]), "--", color=AXIS_COLOUR[axis], lw=0.9)
    panel.set_ylim(bottom=0)
    panel.tick_params(labelsize=size)
    panel.set_xlabel("fraction of the attitudes / %", fontsize=size)
    panel.set_ylabel("u of the corrected\nforce / mg", fontsize=size)
    figure.legend(loc="outside upper left", ncols=3, fontsize=7)


def trade_off_figure(plan: DesignedPlan) -> Figure:
    """The largest standard uncertainty against the time, with common practice."""
    figure = new_figure(7.5, 3.0)
    panel = figure.subplots()
    minutes = [each.minutes for each in plan.traded]
    panel.plot(
        minutes, [each.value for each in plan.traded], "o-", color=AXIS_COLOUR["x"], ms=4, label="designed plans"
    )
    for each in plan.traded:
        panel.annotate(str(each.positions), (each.minutes, each.value), (0, 6), textcoords="offset points", fontsize=7)
    own = min(plan.traded, key=lambda each: abs(each.minutes - plan.minutes))
    panel.plot(own.minutes, own.value, "o", color=INK, ms=7, mfc="none", label="this plan")
    panel.set_xlabel("time / min")
    panel.set_ylabel(f"criterion ({plan.criterion.name})")
    panel.set_ylim(bottom=0)
    panel.legend()
    return figure


def order_figure(plan: DesignedPlan) -> Figure:
    """Spindle angle and pitch setting over time, by mounting."""
    figure = new_figure(7.5, 3.2)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    minutes, cells = plan.after.schedule.start_s / 60, plan.cells
    for panel, angle, name in ((above, cells.alpha_deg, "alpha"), (below, cells.beta_deg, "beta")):
        panel.plot(minutes, angle, "-", color=MUTED, lw=0.6, zorder=1)
        for number, mount in enumerate(dict.fromkeys(cells.mounts)):
            here = cells.mounting == number
            label = f"mounting {mount}" if panel is above else None
            mark = _MARKS[number % len(_MARKS)]
            panel.plot(minutes[here], angle[here], mark, ms=4, color=_colour(number), label=label)
        panel.set_ylabel(f"{name} / °")
        panel.locator_params(axis="y", nbins=5)
    below.set_xlabel("time since the start / min")
    figure.legend(loc="outside upper left", ncols=4, fontsize=7)
    return figure


def _force(plan: DesignedPlan) -> Float[np.ndarray, "positions 3"]:
    """Direction of the specific force in the axes of the sensor."""
    cells = plan.cells
    head = gravity_in_head(np.radians(cells.alpha_deg), np.radians(cells.beta_deg))
    rotations = {
        mount: rotation_matrix(np.radians(plan.rig.mounts.get(mount, (0.0, 0.0, 0.0)))) for mount in cells.mounts
    }
    return np.stack([rotations[mount] @ each for mount, each in zip(cells.mounts, head, strict=True)])


def _colour(number: int) -> str:
    return _MOUNTING[number % len(_MOUNTING)]
