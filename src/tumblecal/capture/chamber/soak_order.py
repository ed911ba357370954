"""The soaks of a plan: consecutive positions at one temperature, and the cost of their order."""

from collections.abc import Sequence
from itertools import groupby, pairwise


def soak_numbers(temperatures: Sequence[float | None]) -> list[int]:
    """The soak of each position, from 0: a new one begins where the temperature changes."""
    return [number for number, (_, same) in enumerate(groupby(temperatures)) for _ in same]


def order_warning(temperatures: Sequence[float | None], stable_min: float) -> str:
    """The cost of a plan that returns to a temperature in the same direction; empty if it does not.

    Arriving from below and from above are different soaks, which show hysteresis. A temperature that is reached twice in one
    direction could be measured in one soak.
    """
    visits = [degc for degc, _ in groupby(temperatures) if degc is not None]
    arrivals = [(after, after > before) for before, after in pairwise(visits)]
    needed = list(dict.fromkeys([(visits[0], None), *arrivals] if visits else []))
    if (surplus := len(visits) - len(needed)) <= 0:
        return ""
    travelled, enough = (
        sum(abs(after - before) for before, after in pairwise(degrees))
        for degrees in (visits, [degc for degc, _ in needed])
    )
    return (
        f"the plan changes the temperature {len(visits) - 1} times for {len(needed)} soaks: {surplus} changes too many cost at "
        f"least {surplus * stable_min:g} min of waiting and {max(travelled - enough, 0.0):g} degC of ramps; list the positions "
        "of each temperature together"
    )
