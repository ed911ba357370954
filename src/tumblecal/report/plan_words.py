"""A designed plan in words: its uncertainties, the improvement, efficiency, effects, and comparison with common practice."""

from collections.abc import Iterator

import numpy as np

from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.chain.rig_file import unit_of_parameter
from tumblecal.design.candidates import Evaluated
from tumblecal.design.plan import DesignedPlan
from tumblecal.ground.counted import counted, shortened
from tumblecal.ground.numbers_shown import decimals, with_decimals
from tumblecal.ground.units import in_words, shown
from tumblecal.report.plan_assumptions import assumptions


def plan_lines(plan: DesignedPlan) -> Iterator[str]:
    """The findings, one line each, the most important first."""
    yield f"{size_words(plan)}: {uncertainty_words(plan.after)}"
    yield before_words(plan)
    yield in_use_words(plan)
    yield from practice_lines(plan)
    for each in assumptions(plan):
        yield f"Assumed: {each.words}. Override with {each.override}"


def size_words(plan: DesignedPlan) -> str:
    """`24 positions in 2 mountings, 90 min`."""
    new = range(plan.measured, len(plan.cells))
    mounts = len({plan.cells.mounts[k] for k in new})
    further = "further " if plan.measured else ""
    return f"{len(new)} {further}positions in {counted(mounts, 'mounting')}, {plan.minutes:.0f} min"


def uncertainty_words(evaluated: Evaluated) -> str:
    """The largest standard uncertainty with its parameter, or the parameters that are not determined."""
    if missing := evaluated.uncertainties.undetermined:
        return f"{shortened(missing, 4)} not determined"
    name, u = evaluated.worst
    return f"largest standard uncertainty {u_words(name, u)} ({name})"


def before_words(plan: DesignedPlan) -> str:
    """The uncertainties without the plan, and the improvement."""
    before = plan.before
    what = "The positions measured already" if plan.measured else "The plan of the rig file"
    words = f"{what} ({counted(len(before.schedule), 'position')}, {before.schedule.minutes:.0f} min): "
    words += uncertainty_words(before)
    if before.uncertainties.undetermined:
        return words
    ratio = relative_worst(before) / relative_worst(plan.after)
    return f"{words}; {times_words(ratio)}"


def times_words(ratio: float) -> str:
    """`3.2 times larger`."""
    return f"{ratio:.2g} times larger" if ratio >= 1 else f"{1 / ratio:.2g} times smaller"


def relative_worst(evaluated: Evaluated) -> float:
    """The largest standard uncertainty in mg, mrad or 1e-3."""
    return float(np.max(evaluated.uncertainties.sd / evaluated.uncertainties.scales))


def in_use_words(plan: DesignedPlan) -> str:
    """Standard uncertainty of the corrected force."""
    average, largest = 1e3 * plan.after.in_use_average, 1e3 * float(np.max(plan.after.in_use))
    words = (
        f"Corrected force in use: standard uncertainty {average:.2g} mg (root mean square over attitudes and axes), "
    )
    return f"{words}at most {largest:.2g} mg"


def practice_lines(plan: DesignedPlan) -> Iterator[str]:
    """The best common practice in the same time."""
    known = [each for each in plan.practice if not each.uncertainties.undetermined and each.fits]
    if known:
        best = min(known, key=relative_worst)
        ratio = relative_worst(best) / relative_worst(plan.after)
        yield (
            f"Best common practice in the same time: {best.positions.name}, {uncertainty_words(best)}; {times_words(ratio)}"
        )


def u_words(name: str, u: float) -> str:
    """A standard uncertainty with its unit, two digits: `0.10 mrad`."""
    unit, factor = shown(unit_of(name))
    return in_words(digits(u * factor), unit)


def digits(u: float) -> str:
    """A standard uncertainty with two significant digits; "" if it is infinite."""
    return with_decimals(u, decimals(u)) if np.isfinite(u) else ""


def unit_of(name: str) -> str:
    """The base unit of a parameter."""
    return unit_of_parameter(name, UNIT_OF_LEAF) or "1"
