"""A designed plan in words: its uncertainties, the improvement, efficiency, effects, and comparison with common practice."""

from collections.abc import Iterator

import numpy as np

from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.chain.rig_file import unit_of_parameter
from tumblecal.design.candidates import Evaluated
from tumblecal.design.forecast.naming import EffectForecast
from tumblecal.design.plan import DesignedPlan
from tumblecal.design.positions.bounds import GOOD
from tumblecal.ground.counted import counted, shortened
from tumblecal.ground.numbers_shown import decimals, with_decimals
from tumblecal.ground.units import in_words, shown
from tumblecal.report.plan_assumptions import assumptions


def plan_lines(plan: DesignedPlan) -> Iterator[str]:
    """The findings, one line each, the most important first."""
    yield f"{size_words(plan)}: {uncertainty_words(plan, plan.after)}"
    yield from undetermined_lines(plan)
    yield before_words(plan)
    yield from efficiency_lines(plan)
    yield in_use_words(plan)
    yield from effect_lines(plan)
    yield from undetectable_lines(plan)
    yield from practice_lines(plan)
    for each in assumptions(plan):
        yield f"Assumed: {each.words}. Override with {each.override}"


def size_words(plan: DesignedPlan) -> str:
    """`24 positions in 2 mountings, 90 min`."""
    new = range(plan.measured, len(plan.cells))
    mounts = len({plan.cells.mounts[k] for k in new})
    further = "further " if plan.measured else ""
    return f"{len(new)} {further}positions in {counted(mounts, 'mounting')}, {plan.minutes:.0f} min"


def uncertainty_words(plan: DesignedPlan, evaluated: Evaluated) -> str:
    """The largest standard uncertainty with its parameter, of the parameters that the plan determines; or those that are not
    determined."""
    if missing := evaluated.undetermined(plan.determined):
        return f"{shortened(missing, 4)} not determined"
    name, u = evaluated.worst(plan.determined)
    return f"largest standard uncertainty {u_words(name, u)} ({name})"


def undetermined_lines(plan: DesignedPlan) -> Iterator[str]:
    """Parameters that no plan on this head determines."""
    if missing := plan.after.uncertainties.undetermined:
        yield (
            f"No plan on this head determines {shortened(missing, 9)}: allow further mountings (--allow-mount) or pitch "
            "settings (--allow-beta)"
        )


def before_words(plan: DesignedPlan) -> str:
    """The uncertainties without the plan, and the improvement."""
    before = plan.before
    what = "The positions measured already" if plan.measured else "The plan of the rig file"
    words = f"{what} ({counted(len(before.schedule), 'position')}, {before.schedule.minutes:.0f} min): "
    words += uncertainty_words(plan, before)
    if before.undetermined(plan.determined):
        return words
    return f"{words}; {times_words(relative_worst(plan, before) / relative_worst(plan, plan.after))}"


def efficiency_lines(plan: DesignedPlan) -> Iterator[str]:
    """The plan's share of its bounds, and the reason if it is far from them."""
    value = plan.ordered.value
    known = f"{percent(plan.ordered.drift_known / value)} of the bound with known slow noise (same visits)"
    if plan.bounds is None:
        yield f"Efficiency of the order: {known}"
        return
    white, once = plan.bounds.repeated / value, plan.bounds.white / value
    yield f"Efficiency: {percent(white)} of the bound under white noise (any plan in these limits); {known}"
    if white < GOOD and plan.bounds.reason:
        yield f"Distance to the bound: {plan.bounds.reason}"
    elif white < GOOD < once:
        yield f"Distance to the bound: it includes repeated visits; {percent(once)} of the bound with one visit of each setting"


def effect_lines(plan: DesignedPlan) -> Iterator[str]:
    """For each effect to be named, its probabilities and the smallest sizes."""
    for each in plan.after.effects:
        yield "; ".join([f"{each.id} of {each.size:g} {each.unit}: {probability_words(each)}", *effect_details(each)])


def probability_words(each: EffectForecast) -> str:
    """`named with probability 0.77, identified with probability 0.59`; one number if both are the same."""
    named, identified = f"{each.named:.2f}", f"{each.identified:.2f}"
    if named == identified:
        return f"named and identified with probability {named}"
    return f"named with probability {named}, identified with probability {identified}"


def effect_details(each: EffectForecast) -> Iterator[str]:
    """The smallest sizes that are named and identified, and the effects from which it is not separated."""
    named, identified = (size_words_of(size, each.unit) for size in (each.smallest_named, each.smallest_identified))
    if not named:
        yield "not named at any size"
    elif named == identified:
        yield f"smallest size named and identified with probability 0.8: {named}"
    else:
        yield f"smallest size named with probability 0.8: {named}, identified: {identified or 'at no size'}"
    if each.identical:
        yield f"identical at 1 g: {', '.join(each.identical)}"
    if each.not_separated:
        yield f"indistinguishable from {shortened(each.not_separated, 3)}"


def size_words_of(size: float | None, unit: str) -> str:
    """A size with its unit, two digits; "" for None."""
    return "" if size is None else f"{size:.2g} {unit}"


def undetectable_lines(plan: DesignedPlan) -> Iterator[str]:
    """Effects that the plan cannot show at any size, and the largest error that others may leave."""
    if plan.forecast is None:
        return
    always, before = plan.forecast.hidden_on_head, plan.before.undetectable
    hidden = [id for id in plan.forecast.undetectable if id not in always]
    words = f"Undetectable with these positions: {shortened(hidden, 6) if hidden else 'no effect'}"
    if before is not None:
        whose = "positions measured already" if plan.measured else "plan of the rig file"
        words += f" ({whose}: {counted(len({*before} - {*always}), 'effect')})"
    yield words + (f"; with any positions of this head: {', '.join(always)}" if always else "")
    if (alias := plan.forecast.alias) is not None:
        yield (
            f"Largest error in use from an effect at its detection limit: {1e3 * alias.error_g:.2g} mg ({alias.effect} of "
            f"{alias.size:.2g} {alias.unit})"
        )


def percent(share: float) -> str:
    """`97 %`; never 100 % for less."""
    return f"{np.floor(1000 * share) / 10 if share > 0.99 else round(100 * share):g} %"


def times_words(ratio: float) -> str:
    """`3.2 times larger`."""
    return f"{ratio:.2g} times larger" if ratio >= 1 else f"{1 / ratio:.2g} times smaller"


def relative_worst(plan: DesignedPlan, evaluated: Evaluated) -> float:
    """The largest standard uncertainty of the parameters that the plan determines, in mg, mrad or 1e-3."""
    name, u = evaluated.worst(plan.determined)
    return u / float(plan.after.uncertainties.scales[plan.after.uncertainties.names.index(name)])


def in_use_words(plan: DesignedPlan) -> str:
    """Standard uncertainty of the corrected force."""
    return f"Standard uncertainty of the corrected force in use: {in_use_size(plan)}"


def in_use_size(plan: DesignedPlan) -> str:
    """`0.074 mg (root mean square over attitudes and axes), at most 0.11 mg`."""
    if plan.after.uncertainties.undetermined:
        return "not determined, because parameters are not"
    average, largest = 1e3 * plan.after.in_use_average, 1e3 * float(np.max(plan.after.in_use))
    return f"{digits(average)} mg (root mean square over attitudes and axes), at most {digits(largest)} mg"


def practice_lines(plan: DesignedPlan) -> Iterator[str]:
    """The best common practice in the same time."""
    known = [each for each in plan.practice if each.fits and not each.undetermined(plan.determined)]
    if known:
        best = min(known, key=lambda each: relative_worst(plan, each))
        ratio = times_words(relative_worst(plan, best) / relative_worst(plan, plan.after))
        yield f"Best common practice in the same time: {best.positions.name}, {uncertainty_words(plan, best)}; {ratio}"


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
