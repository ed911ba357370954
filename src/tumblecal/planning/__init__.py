"""What to measure next: from a diagnosis to a plan."""

from tumblecal.planning.next_plan import NextPlan as NextPlan
from tumblecal.planning.next_plan import next_plan as next_plan
from tumblecal.planning.proposals import Allowed as Allowed
