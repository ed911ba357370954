"""What to measure next: from a diagnosis to a plan. The names of `tumblecal.plan.next` for a user's program."""

from tumblecal.plan.next.next_plan import NextPlan, next_plan
from tumblecal.plan.next.proposals import Allowed


__all__ = [
    "Allowed",
    "NextPlan",
    "next_plan",
]
