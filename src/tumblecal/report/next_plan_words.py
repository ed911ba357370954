"""What to measure next, in words."""

import math
from collections.abc import Iterator

from tumblecal.planning.next_plan import SEPARATE, SHARPEN_WEAKEST, NextPlan, NextPosition


def next_words(plan: NextPlan, rival: str) -> Iterator[str]:
    """The reading that confirms what was named, the positions that go well together, and what to know of them.

    **Arguments:**

    - `rival`: the strongest rival of what was named, in words; empty where there is none.
    """
    if plan.confirming:
        clearest = plan.confirming[0]
        yield (
            f"To confirm it, measure alpha {clearest.alpha_deg:g} at beta {clearest.beta_deg:g} (anew, or again): "
            f"{clearest.axis} reads {clearest.expected_g:.5f} g (sd {clearest.expected_sd_g * 1e3:.2g} mg) if it is so, "
            f"{clearest.rival_g:.5f} g (sd {clearest.sd_g * 1e3:.2g} mg) if {rival or 'nothing is wrong'}."
        )
    if plan.together:
        yield f"Measure next, to {plan.purpose}: {'; '.join(_grouped(plan.together))}. {_promise(plan)}"
    yield from plan.notes


def _grouped(chosen: tuple[NextPosition, ...]) -> Iterator[str]:
    """Positions in words, those of one mounting and pitch setting together."""
    together: dict[tuple[str, float], list[float]] = {}
    yield from (position.direction for position in chosen if position.direction)
    for position in chosen:
        if position.direction:
            continue
        together.setdefault((position.mount, position.beta_deg), []).extend(position.turn_deg or (position.alpha_deg,))
    for (mount, beta), alphas in together.items():
        listed = ", ".join(f"{alpha:g}" for alpha in alphas)
        yield f"alpha {listed} at beta {beta:g}{f' with the triad {mount}' if mount else ''}"


def _promise(plan: NextPlan) -> str:
    if plan.purpose == SEPARATE:
        # Beyond e^20 a number says nothing.
        return (
            f"Expected: the odds of the other explanations fall by a factor of {math.exp(min(plan.value, 20.0)):.2g}."
        )
    if plan.purpose == SHARPEN_WEAKEST:
        return f"Expected: it falls by {100 * plan.value:.0f} %."
    return f"Expected: the sd of the worst parameter ({plan.watched} now) falls by {100 * plan.value:.0f} %."
