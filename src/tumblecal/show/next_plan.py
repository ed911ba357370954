"""The next measurement for people: its words, and the plans of capture with comments."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import label_words
from tumblecal.diagnosis.findings.factors import Factor
from tumblecal.ground.errors import one_line
from tumblecal.ground.strict_toml import toml_lines
from tumblecal.plan.next.next_capture import NextCapture, next_captures, next_commands, setup_of
from tumblecal.plan.next.next_plan import SEPARATE, NextPlan
from tumblecal.plan.next.proposals import SAMPLE
from tumblecal.plan.next.separating import LEAST_WORTH_ODDS
from tumblecal.show.words import Words, words_of


def next_words(
    diagnosis: Diagnosis, plan: NextPlan, folder: Path | None, numbers: Mapping[str, int] | None = None
) -> list[str]:
    """Instructions and commands, a paragraph or command each.

    `folder`: where the plans are written; None: no plans, so no commands. `numbers`: of the findings, by label.
    """
    captures = [] if folder is None else next_captures(diagnosis, plan)
    return _words(diagnosis, plan, captures, folder or Path(), numbers or {}).lines("next")


def next_plan_texts(diagnosis: Diagnosis, plan: NextPlan, folder: Path) -> dict[str, str]:
    """The plans of capture for a folder, by the names of their files."""
    captures = next_captures(diagnosis, plan)
    words, texts = _words(diagnosis, plan, captures, folder, {}), {}
    for one in captures:
        comments = [f"# {one_line(line)}" for line in words.lines(one.file)]
        texts[one.file] = "\n".join([*comments, "", *toml_lines(one.content)])
    return texts


def _words(
    diagnosis: Diagnosis, plan: NextPlan, captures: Sequence[NextCapture], folder: Path, numbers: Mapping[str, int]
) -> Words:
    """The words of a plan, and those in the file of each capture."""

    def about(chosen: Iterable[Factor]) -> list[int]:
        return sorted({numbers[label] for factor in chosen for label in factor.members[0] if label in numbers})

    factors, promise = diagnosis.factors if plan.promise is not None else (), plan.promise
    unresolved = [factor for factor in factors if not factor.resolved]
    remaining = [{*labels} for labels in promise.remaining] if promise is not None else []
    return words_of(
        "next_plan",
        plan=plan,
        separate=plan.purpose == SEPARATE,
        sample=plan.purpose == SAMPLE,
        least_odds=LEAST_WORTH_ODDS,
        open=about(unresolved),
        # Every remaining explanation includes the leading cause of these.
        settled=about(factor for factor in unresolved if all({*factor.members[0]} <= labels for labels in remaining)),
        identical=about(factor for factor in factors if any(one.kind == "identity" for one in factor.reasons)),
        captures=captures,
        captured=setup_of(diagnosis) is not None if captures else False,
        commands=next_commands(diagnosis, captures, folder) if captures else [],
        label=label_words,
        duration=_duration,
    )


def _duration(seconds: float) -> str:
    """A time in words, s, min or h."""
    unit, size = next((one for one in (("h", 3600.0), ("min", 60.0)) if seconds >= 1.5 * one[1]), ("s", 1.0))
    return f"{float(f'{seconds / size:.2g}'):g} {unit}"
