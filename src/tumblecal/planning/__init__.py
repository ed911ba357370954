"""What to measure next: from a diagnosis to a plan."""

from tumblecal.planning.next_plan import NextPlan, next_plan
from tumblecal.planning.proposals import Allowed


__all__ = [
    "Allowed",
    "NextPlan",
    "next_plan",
]
