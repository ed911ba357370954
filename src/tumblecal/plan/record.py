"""`plan.json`: a designed plan in numbers."""

from collections.abc import Sequence
from typing import Any

from tumblecal.plan.candidates import Evaluated
from tumblecal.plan.design import DesignedPlan


SCHEMA = "tumblecal.plan/1"


def plan_record(
    plan: DesignedPlan, files: Sequence[str], lines: Sequence[str], assumptions: Sequence[tuple[str, str]]
) -> dict[str, Any]:
    """The plan as plain numbers, lists and texts.

    **Arguments:**

    - `files`: that were written. `lines`: that are printed. `assumptions`: each with the option that overrides it.
    """
    schedule, wanted, bounds, forecast = plan.after.schedule, plan.wanted, plan.found.bounds, plan.forecast
    return {
        "schema": SCHEMA,
        "source": plan.rig.source,
        "files": files,
        "positions": [
            {"temperature_degc": None, **position, "start_s": start, "measured": k < plan.measured}
            for k, (position, start) in enumerate(zip(plan.positions, schedule.start_s.tolist(), strict=True))
        ],
        "minutes": plan.minutes,
        "pitch_visits": int(schedule.pitch_visit[-1]) + 1,
        "mount_visits": int(schedule.mount_visit[-1]) + 1,
        "criteria": wanted.criteria,
        "order": wanted.order,
        "seed": wanted.seed,
        "parameters": {name: {"u": u, "u_before": before, "unit": unit} for name, unit, before, u in plan.parameters},
        "in_use_g": _in_use(plan.after),
        "criterion": {
            "value": plan.found.ordered.value,
            "slow_noise_known": plan.found.ordered.drift_known,
            "bound_white": bounds and bounds.repeated,
            "bound_one_visit": bounds and bounds.white,
            "bound_of_positions": bounds and bounds.own,
            "reason": (bounds and bounds.reason) or None,
        },
        "effects": plan.after.effects,
        "forecast": forecast
        and {
            "draws": forecast.draws,
            "detection_limits": {
                id: {"size": size, "unit": plan.units.get(id)} for id, size in forecast.limits.items()
            },
            "undetectable": forecast.undetectable,
            "hidden_on_head": forecast.hidden_on_head,
            "not_testable": forecast.not_testable,
            "alias": forecast.alias,
            "alias_of_undetectable": forecast.alias_of_undetectable,
        },
        "before": _evaluated(plan, plan.before),
        "practice": [_evaluated(plan, each) for each in plan.practice],
        "trade_off": [each._asdict() for each in plan.found.traded],
        "assumptions": [{"words": words, "override": option} for words, option in assumptions],
        "words": lines,
    }


def _evaluated(plan: DesignedPlan, evaluated: Evaluated) -> dict[str, Any]:
    parameter, u = evaluated.worst(plan.determined)
    return {
        "name": evaluated.positions.name,
        "source": evaluated.positions.source or None,
        "positions": len(evaluated.schedule),
        "minutes": evaluated.schedule.minutes,
        "fits": evaluated.fits,
        "deviation_deg": evaluated.positions.deviation_deg,
        "worst": {"parameter": parameter, "u": u},
        "undetermined": evaluated.uncertainties.undetermined,
        "in_use_g": _in_use(evaluated),
        "effects": evaluated.effects,
        "undetectable": evaluated.undetectable,
    }


def _in_use(evaluated: Evaluated) -> dict[str, float]:
    return {"average": evaluated.in_use_average, "largest": evaluated.in_use_largest}
