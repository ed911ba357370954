"""Tables of a designed plan: uncertainties, positions, comparison with common practice, assumptions."""

import numpy as np

from tumblecal.design.candidates import Evaluated
from tumblecal.design.plan import DesignedPlan
from tumblecal.ground.units import shown
from tumblecal.report.plan_assumptions import assumptions
from tumblecal.report.plan_words import digits, relative_worst, u_words, unit_of
from tumblecal.show.tables import Table, number


def uncertainty_table(plan: DesignedPlan) -> Table:
    """Standard uncertainties before and after."""
    before, after = plan.before.uncertainties, plan.after.uncertainties
    rows = []
    for name, old, new in zip(after.names, before.sd.tolist(), after.sd.tolist(), strict=True):
        unit, factor = shown(unit_of(name))
        ratio = f"{old / new:.2g}" if np.isfinite(old) and np.isfinite(new) else ""
        sizes = [digits(u * factor) or "not determined" for u in (old, new)]
        rows.append([name, *sizes, unit, ratio])
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


def practice_table(plan: DesignedPlan, *, short: bool = False) -> Table:
    """The plan and common practice on the same head in the same time; `short`: without sources and deviations."""
    rows = [_row(plan, each, short=short) for each in (plan.after, *plan.practice)]
    header = ["plan", "positions", "min", "largest u", "parameter", "ratio", "in use\n/ mg"]
    header += [] if plan.forecast is None else ["undetectable"]
    header += [] if short else ["deviation\n/ deg"]
    return Table(header, rows, text=(0, 4), marked={(0, column) for column in range(len(header))})


def named_table(plan: DesignedPlan) -> Table:
    """Probability that each plan names each effect, and the smallest size named with probability 0.8."""
    effects = plan.after.effects
    rows = [
        [
            each.positions.name,
            *(f"{effect.named:.2f}" for effect in each.effects),
            *(number(effect.smallest_named, 2) or "none" for effect in each.effects),
        ]
        for each in (plan.after, plan.before, *plan.practice)
    ]
    header = [f"{each.id}\n{each.size:g} {each.unit}" for each in effects]
    header += [f"{each.id}\nsmallest / ({each.unit})" for each in effects]
    return Table(["plan", *header], rows, text=(0,), marked={(0, column) for column in range(len(header) + 1)})


def effect_table(plan: DesignedPlan) -> Table:
    """Forecasts of the effects to be named; sizes for a probability of 0.8."""
    rows = [
        [
            each.id,
            f"{each.size:g}",
            each.unit,
            f"{each.detected:.2f}",
            f"{each.named:.2f}",
            f"{each.identified:.2f}",
            number(each.detection_limit, 2),
            number(each.smallest_named, 2) or "none",
            number(each.smallest_identified, 2) or "none",
            ", ".join((*each.identical, *each.not_separated)),
        ]
        for each in plan.after.effects
    ]
    header = ["effect", "size", "unit", "detected", "named", "identified", "detection\nlimit", "smallest\nnamed"]
    return Table([*header, "smallest\nidentified", "not separated from"], rows, text=(0, 2, 9))


def limit_table(plan: DesignedPlan) -> Table:
    """Detection limits of all effects: sizes detected with probability 0.8."""
    limits = {} if plan.forecast is None else plan.forecast.limits
    rows = [[id, number(size, 2) or "undetectable", plan.units.get(id, "")] for id, size in limits.items()]
    return Table(["effect", "detection limit", "unit"], rows, text=(2,), folded=True)


def _row(plan: DesignedPlan, each: Evaluated, *, short: bool) -> list[str]:
    name, u = each.worst(plan.determined)
    undetermined = each.undetermined(plan.determined)
    ratio = relative_worst(plan, each) / relative_worst(plan, plan.after)
    deviation = each.positions.deviation_deg
    source = "" if short or not each.positions.source else f" ({each.positions.source})"
    return [
        f"{each.positions.name}{source}",
        str(len(each.schedule)),
        f"{each.schedule.minutes:.0f}{'' if each.fits else ' (too long)'}",
        "not determined" if undetermined else u_words(name, u),
        ", ".join(undetermined) if undetermined else name,
        "" if undetermined else f"{ratio:.2g}",
        digits(1e3 * each.in_use_average),
        *([] if plan.forecast is None else [str(len(each.undetectable or ()))]),
        *([] if short else [f"{deviation:.1f}" if deviation > 0.05 else ""]),
    ]


def assumption_table(plan: DesignedPlan) -> Table:
    """Assumptions with the options that override them."""
    return Table(["assumed", "override"], [list(each) for each in assumptions(plan)], text=(0, 1))
