"""The next measurement in words: positions, conditions, commands, and the questions that it settles."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import label_words
from tumblecal.diagnosis.findings.factors import Factor
from tumblecal.ground.numbers_shown import rounded_together
from tumblecal.planning.next_plan import SEPARATE, SHARPEN_WEAKEST, NextPlan, NextPosition
from tumblecal.planning.promise import LEAST_WORTH_ODDS, Promise
from tumblecal.planning.sampling import SAMPLE
from tumblecal.report.next_plan_files import conditions_words, duration, next_commands


# Odds above this are not stated more exactly.
_MOST_ODDS = 1000.0


def next_words(
    diagnosis: Diagnosis, plan: NextPlan, folder: Path | None, numbers: Mapping[str, int] | None = None
) -> Iterator[str]:
    """Instructions and commands, a paragraph or command each.

    `folder`: where the plans are written; None: no plans, so no commands. `numbers`: of the findings, by label.
    """
    factors = diagnosis.factors if plan.promise is not None else ()
    numbers = numbers or {}
    if plan.promise is not None and plan.purpose != SEPARATE:
        yield not_worth_words(plan.promise, open_numbers(factors, numbers))
    if plan.together:
        conditions = "" if plan.conditions is None else conditions_words(plan.conditions)
        promise = _promise(plan, settled_numbers(factors, plan.promise, numbers))
        whole = f"all {len(plan.together)} positions of the last run again, in the reverse order"
        positions = whole if plan.in_reverse else "; ".join(_grouped(plan.together))
        yield f"Measure next, to {plan.purpose} ({_total(plan)}): {positions}{conditions}. {promise}"
        if folder is not None:
            yield from next_commands(diagnosis, plan, folder)
    if plan.purpose == SEPARATE and plan.promise is not None and plan.promise.remaining:
        listed = "; ".join(label_words(labels) for labels in plan.promise.remaining)
        yield f"Not separated by these positions: {listed}."
    if identical := [number for factor in factors for number in _about(factor, numbers) if _of_identity(factor)]:
        yield f"No measurement on a head settles {_listed(identical)} further: the same function at 1 g."
    yield from plan.notes
    if plan.confirming:
        clearest = plan.confirming[0]
        yield (
            "To test the cause found, under the same conditions, measure alpha "
            f"{clearest.alpha_deg:g} at beta {clearest.beta_deg:g}. Predicted reading of {clearest.axis}: "
            f"{rounded_together(clearest.expected_g * 1e3, clearest.expected_sd_g * 1e3)} mg by the named cause, "
            f"{rounded_together(clearest.rival_g * 1e3, clearest.sd_g * 1e3)} mg by "
            f"{label_words(clearest.rival) or 'the nominal model'}."
        )


def _total(plan: NextPlan) -> str:
    """Number of positions, and the time until the last of them if the data state times."""
    conditions, count = plan.conditions, f"{plan.positions} position{'s' if plan.positions > 1 else ''}"
    if conditions is None or conditions.after_s is None:
        return count
    return f"{count}, {duration(conditions.after_s + (plan.positions - 1) * conditions.step_s)} in all"


def open_numbers(factors: Iterable[Factor], numbers: Mapping[str, int]) -> list[int]:
    """Numbers of the findings whose cause is not resolved."""
    return sorted({number for factor in factors if not factor.resolved for number in _about(factor, numbers)})


def settled_numbers(factors: Iterable[Factor], promise: Promise | None, numbers: Mapping[str, int]) -> list[int]:
    """Numbers of the findings that the new positions settle: every remaining explanation includes the leading cause."""
    if promise is None:
        return []
    closed = [factor for factor in factors if all({*factor.members[0]} <= {*labels} for labels in promise.remaining)]
    return open_numbers(closed, numbers)


def _about(factor: Factor, numbers: Mapping[str, int]) -> list[int]:
    return [numbers[label] for label in factor.members[0] if label in numbers]


def _of_identity(factor: Factor) -> bool:
    return any(reason.kind == "identity" for reason in factor.reasons)


def _listed(numbers: Sequence[int]) -> str:
    return " and ".join(str(number) for number in dict.fromkeys(numbers))


def not_worth_words(promise: Promise, about: Sequence[int]) -> str:
    """Why no positions are proposed to separate the explanations, and which measurement would separate them."""
    purpose = f"to settle {_listed(about)}" if about else "to separate the leading explanations"
    odds = "no proposed position separates them" if promise.odds < 2 else f"expected odds {promise.odds:.2g} to 1"
    return (
        f"Not worth measuring {purpose}: {odds}, below {LEAST_WORTH_ODDS:g} to 1. More repeats, other pitch angles, another "
        "mounting, or a larger range of time or temperature may be."
    )


def _grouped(chosen: tuple[NextPosition, ...]) -> Iterator[str]:
    """Positions in words, those of one mounting and pitch setting together."""
    together: dict[tuple[str, float], list[float]] = {}
    yield from (position.direction for position in chosen if position.direction)
    for position in sorted(chosen, key=lambda position: position.mount):
        if position.direction:
            continue
        together.setdefault((position.mount, position.beta_deg), []).extend(position.turn_deg or (position.alpha_deg,))
    for (mount, beta), alphas in together.items():
        listed = ", ".join(f"{alpha:g}" for alpha in alphas)
        yield f"alpha {listed} at beta {beta:g}{f' with the triad {mount}' if mount else ''}"


def _promise(plan: NextPlan, settled: Sequence[int]) -> str:
    """The expected result of the plan.

    `settled`: numbers of the findings that it settles.
    """
    if plan.purpose == SEPARATE and plan.promise is not None:
        promise = plan.promise
        odds = f"> {_MOST_ODDS:g}" if promise.odds > _MOST_ODDS else f"{promise.odds:.2g}"
        question = _listed(settled) if settled else "which of the explanations is true"
        verb = "settles" if promise.made else "may settle"
        return f"This {verb} {question} (probability {promise.probability:.2f}; expected odds {odds} to 1 among those listed)."
    if plan.purpose == SAMPLE:
        return "They show whether the error repeats, and how it changes between the measured angles."
    if plan.purpose == SHARPEN_WEAKEST:
        return f"Expected: it decreases by {100 * plan.value:.0f} %."
    return f"Expected: u({plan.watched}), the largest now, decreases by {100 * plan.value:.0f} %."
