"""Tables of a designed plan: uncertainties, positions, comparison with common practice, assumptions."""

import numpy as np

from tumblecal.design.candidates import Evaluated
from tumblecal.design.plan import DesignedPlan
from tumblecal.ground.units import shown
from tumblecal.report.plan_assumptions import assumptions
from tumblecal.report.plan_words import digits, relative_worst, u_words, unit_of
from tumblecal.report.tables import Table


def uncertainty_table(plan: DesignedPlan) -> Table:
    """Standard uncertainties before and after."""
    before, after = plan.before.uncertainties, plan.after.uncertainties
    rows = []
    for name, old, new in zip(after.names, before.sd.tolist(), after.sd.tolist(), strict=True):
        unit, factor = shown(unit_of(name))
        ratio = f"{old / new:.2g}" if np.isfinite(old) else ""
        rows.append([name, digits(old * factor) or "not determined", digits(new * factor), unit, ratio])
    return Table(["parameter", "u before", "u of the plan", "unit", "ratio"], rows, text=(3,))


def position_table(plan: DesignedPlan) -> Table:
    """The new positions in measuring order."""
    cells, schedule = plan.cells, plan.after.schedule
    degc = cells.temperature_degc
    rows = [
        [
            plan.names[k],
            f"{schedule.start_s[k] / 60:.1f}",
            cells.mounts[k],
            f"{cells.beta_deg[k]:g}",
            f"{cells.alpha_deg[k]:g}",
            *([] if degc is None else [f"{degc[k]:g}"]),
        ]
        for k in range(plan.measured, len(cells))
    ]
    header = ["position", "start / min", "mounting", "beta / deg", "alpha / deg"]
    return Table([*header, *([] if degc is None else ["temperature / degC"])], rows, text=(2,))


def practice_table(plan: DesignedPlan) -> Table:
    """The plan and common practice on the same head in the same time."""
    rows = [_row(plan, each) for each in (plan.after, *plan.practice)]
    header = ["plan", "positions", "min", "largest u", "parameter", "times\nlarger", "in use / mg", "deviation / deg"]
    return Table(header, rows, text=(0, 4), marked={(0, column) for column in range(len(header))})


def _row(plan: DesignedPlan, each: Evaluated) -> list[str]:
    name, u = each.worst
    undetermined = each.uncertainties.undetermined
    ratio = relative_worst(each) / relative_worst(plan.after)
    deviation = each.positions.deviation_deg
    return [
        f"{each.positions.name}{f' ({each.positions.source})' if each.positions.source else ''}",
        str(len(each.schedule)),
        f"{each.schedule.minutes:.0f}{'' if each.fits else ' (too long)'}",
        "not determined" if undetermined else u_words(name, u),
        ", ".join(undetermined) if undetermined else name,
        "" if undetermined else f"{ratio:.2g}",
        "" if undetermined else f"{1e3 * each.in_use_average:.2g}",
        f"{deviation:.1f}" if deviation > 0.05 else "",
    ]


def assumption_table(plan: DesignedPlan) -> Table:
    """Assumptions with the options that override them."""
    return Table(["assumed", "override"], [list(each) for each in assumptions(plan)], text=(0, 1))
