"""The one judge of the blind studies: an answer of the diagnosis against the hidden truth."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import binomtest

from command_line import print_head, print_row


UNEXPLAINED = "unexplained"
# A single set with a higher probability than this that is not the truth counts as wrong.
SURE = 0.9
BINS = (0.0, 0.3, 0.5, 0.7, 0.85, 0.95, 1.0)
Labels = tuple[str, ...]


@dataclass(frozen=True)
class Case:
    """A hidden cause and the data that a user would have.

    - `accepted`: sets of labels that are correct answers; the first one is hidden. None: only a rejection is correct.
    - `data`: input of the diagnosis; `hidden`: record of the simulator; `d`: size in sigma.
    - `excused`: prefixes of labels that may be named in addition. `refusal`: an error message is a correct answer.
    """

    kind: str
    number: int
    plan: str
    known: bool
    accepted: tuple[Labels, ...]
    data: Any
    hidden: Any = None
    d: float = 0.0
    excused: Labels = ()
    refusal: bool = False


@dataclass(frozen=True)
class Answer:
    """The answer to a case.

    - `classes`: the named set, then the sets that are indistinguishable from it; `identical`: those with the same function at
      1 g; `powers`: those with another number of powers of one polynomial. `single`: one set is claimed alone.
    - `words`: first line, or an error message. `measures`: further numbers by column of the table.
    """

    labels: Labels
    classes: tuple[Labels, ...]
    probability: float
    verdict: str
    single: bool
    detected: bool
    identical: tuple[Labels, ...] = ()
    powers: tuple[Labels, ...] = ()
    words: str = ""
    refused: bool = False
    crashed: bool = False
    measures: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """A judged case.

    - `right`: the hidden set is in the stated class (for a cause without an entry: `unexplained`); `strict`: it leads.
    - `alone`: it, or the same function at 1 g, is the only claim; `identified`: the verdict as well.
    - `stated`: the statement that has the probability is true. `wrong`: a different set is claimed with more than `SURE`.
    """

    case: Case
    answer: Answer
    right: bool
    strict: bool
    stated: bool
    alone: bool
    identified: bool
    wrong: bool

    @property
    def detected(self) -> bool:
        """Whether anything is reported."""
        return self.answer.detected

    @property
    def crashed(self) -> bool:
        """Whether the command ended in a traceback."""
        return self.answer.crashed


def judged(case: Case, answer: Answer) -> Outcome:
    """Compare an answer with the truth."""

    def without(sets: Iterable[Labels]) -> list[Labels]:
        return [tuple(label for label in own if not label.startswith(case.excused or ("\0",))) for own in sets]

    accepted, truth = case.accepted, case.accepted[0] if case.accepted else ()
    (labels,), classes = without([answer.labels]), without(answer.classes)
    identical, powers = without(answer.identical), without(answer.powers)

    def correct(own: Labels) -> bool:
        unexplained = (UNEXPLAINED,) in accepted and UNEXPLAINED in own
        return own in accepted or (unexplained and all(one in truth for one in own if one.startswith("noise_")))

    if not accepted:
        right = strict = stated = alone = False
    elif not truth:
        detected = bool(labels) if case.excused else answer.detected
        right = strict = stated = alone = not (detected or answer.crashed or answer.refused)
    else:
        right, strict = any(map(correct, classes)), correct(labels)
        if (UNEXPLAINED,) in accepted:
            stated, alone = right, strict and (answer.verdict == UNEXPLAINED or UNEXPLAINED not in labels)
        else:
            alone = answer.single and right and (strict or any(map(correct, identical)))
            stated = alone or any(map(correct, powers)) if answer.single else right
    if case.refusal and answer.refused:
        right = strict = stated = alone = True
    sure = answer.single and bool(labels) and UNEXPLAINED not in labels and answer.probability > SURE
    identified = alone and answer.verdict == "identified"
    return Outcome(case, answer, right, strict, stated, alone, identified, sure and not stated)


def answer_of(best, noise: Iterable[str], verdict: str, detected: bool, **more: Any) -> Answer:
    """The answer with a leading explanation of `tumblecal.diagnosis` and faults of the noise."""
    noise = tuple(noise)

    def with_noise(sets):
        return tuple(tuple(sorted({*own, *noise})) for own in sets)

    labels, *others = with_noise([best.labels, *best.equivalents])
    if best.single_name:
        # An unclaimed cause without a name is no part of the statement.
        others = [own for own in others if UNEXPLAINED not in own]
    return Answer(
        labels,
        (labels, *others),
        best.probability,
        verdict,
        best.single_name,
        detected,
        identical=with_noise(best.identical),
        powers=with_noise(best.powers),
        **more,
    )


def answer_of_diagnosis(diagnosis, **more: Any) -> Answer:
    """The answer of a diagnosis."""
    verdict = diagnosis.verdict
    return answer_of(diagnosis.best, diagnosis.noise_labels, verdict, verdict != "adequate", **more)


def answer_of_record(record: dict | None, refusal: str) -> Answer:
    """The answer in diagnosis.json, or in an error message."""
    if record is None:
        crashed = refusal.startswith("crash")
        return Answer((), (), 0.0, "refused", False, True, words=refusal, refused=not crashed, crashed=crashed)
    best = record["explanations"][0] if record["explanations"] else {"equivalents": [], "probability": 0.0}
    labels, of_noise = tuple(sorted(record["causes"])), record.get("noise_rivals", {})
    classes = [labels, *([tuple(sorted({of_noise.get(name, name) for name in labels}))] if of_noise else [])]
    classes += [tuple(sorted(name.replace(" at ", ":") for name in names)) for names in best["equivalents"]]
    # A corrected set-up error is reported with those that leave the same data.
    corrected = record.get("set_up", [])
    ids = {own["id"] for own in corrected}
    hypotheses = [ids, *(ids - {own["id"]} | {same["id"]} for own in corrected for same in own["equal"])]
    classes = [tuple(sorted({*names} - ids | others)) for names in classes for others in hypotheses]
    single = len(classes) == 1 and bool(labels) and UNEXPLAINED not in labels
    words = record["text"].partition("\n")[0]
    return Answer(labels, tuple(classes), best["probability"], record["verdict"], single, bool(labels), words=words)


def against(best, truth: Labels, noise: Iterable[str] = ()) -> Outcome:
    """A leading explanation and faults of the noise against a hidden set."""
    return judged(Case("", 0, "", True, (truth,), None), answer_of(best, noise, "", bool(best.labels)))


def interval(yes: int, of: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson)."""
    low, high = binomtest(int(yes), of).proportion_ci(method="wilson")
    return float(low), float(high)


def print_reliability(statements: Iterable[tuple[float, bool]], bins: Sequence[float] = BINS) -> None:
    """Stated probabilities, and how often they were correct."""
    listed = np.array(list(statements), float).reshape(-1, 2)
    print()
    print_head("stated probability", "statements", "mean", "correct")
    for low, high in pairwise(bins):
        here = listed[(listed[:, 0] >= low) & (listed[:, 0] < (high if high < 1.0 else np.inf))]
        if len(here):
            mean, share = here.mean(axis=0)
            print_row(f"{low:.2f} to {high:.2f}", len(here), f"{mean:.3f}", f"{share:.3f}")
