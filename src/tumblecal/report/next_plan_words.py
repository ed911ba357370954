"""What to measure next, in words: positions, conditions, commands, and what it settles."""

import math
from collections.abc import Iterator
from pathlib import Path

from tumblecal.diagnosis import Diagnosis
from tumblecal.planning.new_rows import assumed_temperature
from tumblecal.planning.next_plan import SEPARATE, SHARPEN_WEAKEST, NextPlan, NextPosition
from tumblecal.report.cause_words import label_words
from tumblecal.report.next_plan_files import next_commands


def next_words(diagnosis: Diagnosis, plan: NextPlan, folder: Path | None) -> Iterator[str]:
    """Instructions and commands, a paragraph or command each.

    **Arguments:**

    - `folder`: where the plans are written; None: nowhere, so no commands.
    """
    if plan.together:
        yield f"Measure next, to {plan.purpose}: {'; '.join(_grouped(plan.together))}{_conditions(diagnosis)}. {_promise(plan)}"
        if folder is not None:
            yield from next_commands(diagnosis, plan, folder)
    yield from plan.notes
    if plan.confirming:
        clearest = plan.confirming[0]
        yield (
            f"To test the cause found, measure alpha {clearest.alpha_deg:g} at beta {clearest.beta_deg:g}: "
            f"{clearest.axis} reads {clearest.expected_g:.5f} g (sd {clearest.expected_sd_g * 1e3:.2g} mg) if it is "
            f"present, {clearest.rival_g:.5f} g (sd {clearest.sd_g * 1e3:.2g} mg) if "
            f"{label_words(clearest.rival) or 'no error is present'}."
        )


def _conditions(diagnosis: Diagnosis) -> str:
    """Time and temperature for which the new positions are evaluated."""
    data = diagnosis.data
    if data.hand_held:
        return ""
    when = ", directly after this measurement" if data.time_s is not None else ""
    degc = assumed_temperature(data.temperature_degc)
    if data.temperature_degc is None or degc is None:
        return when
    return f"{when}, at about {degc:.1f} degC (last position: {data.temperature_degc[-1]:.1f} degC)"


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
        odds = math.exp(min(plan.value, 20.0))
        factor = "more than 1000" if odds > 1000 else f"{odds:.2g}"
        return f"Expected: odds against the alternatives rise by a factor of {factor}."
    if plan.purpose == SHARPEN_WEAKEST:
        return f"Expected: it falls by {100 * plan.value:.0f} %."
    return f"Expected: u({plan.watched}), the largest now, falls by {100 * plan.value:.0f} %."
