"""The next measurement in numbers, a part of `diagnosis.json`."""

from typing import Any

from tumblecal.plan.next.next_plan import NextPlan


def plan_record(plan: NextPlan) -> dict[str, Any]:
    """The plan as plain numbers, lists and texts; angles in deg, readings in g."""
    conditions, promise = plan.conditions, plan.promise
    # How the triad is turned in its fixture; "" for the present mounting.
    mounting = list(dict.fromkeys(position.mount for position in plan.together))
    return {
        "next_positions": plan.singles,
        "next_plan": {
            "purpose": plan.purpose or None,
            "watched": plan.watched or None,
            "in_reverse": plan.in_reverse,
            "value": plan.value,
            "together": plan.together,
            "notes": plan.notes,
            "confirming": [vars(reading) | {"sd_apart": reading.sd_apart} for reading in plan.confirming],
        },
        "next": {
            "conditions": None
            if conditions is None
            else {**conditions._asdict(), "mounting": mounting, "order": "as listed in the plan"},
            "promise": None
            if promise is None
            else vars(promise) | {"made": promise.made, "worth_measuring": promise.worth_measuring},
        },
    }
