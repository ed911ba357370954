"""What to measure next: from a diagnosis to a plan, and the best angles of a plan."""

from tumblecal.planning.continuous_angles import OptimisedPlan, optimise_plan
from tumblecal.planning.next_plan import NextPlan, next_plan
from tumblecal.planning.proposals import Allowed


__all__ = [
    "Allowed",
    "NextPlan",
    "OptimisedPlan",
    "next_plan",
    "optimise_plan",
]
