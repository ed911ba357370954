"""Cases of the blind studies, answers of the diagnosis, and how one is judged by the other: the same for all simulators."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import binomtest


if TYPE_CHECKING:
    from tumblecal.diagnosis import Diagnosis
    from tumblecal.diagnosis.sets.explanation import Explanation


UNEXPLAINED = "unexplained"
BINS = (0.0, 0.3, 0.5, 0.7, 0.85, 0.95, 1.0)
# A single set that is claimed with more than this probability and is not the truth counts as wrong.
SURE = 0.9
Labels = tuple[str, ...]


@dataclass(frozen=True)
class Case:
    """A hidden cause and the data that a user would have.

    - `kind`: name of the kind in its simulator; `number`: of the case within its kind; `d`: size, if one is asked for.
    - `accepted`: the sets of labels of which each is a correct answer; the first one is the hidden set.
    - `data`: given to the diagnosis; `hidden`: the simulator's record of what it hid, for its further measures.
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
    """The answer to a case, however it was obtained.

    - `labels`: all named causes; `classes`: these and the sets that are stated to be indistinguishable from them;
      `identical`: those of them that are the same function at 1 g; `powers`: those with more or fewer powers of the same
      polynomial. `single`: one set is claimed alone.
    - `detected`: anything is reported. `words`: the first line, or an error message; `refused`, `crashed`: nothing else exists.
    - `measures`: further numbers of the simulator, by column of the table.
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


def answer_of(best: "Explanation", noise: Iterable[str], verdict: str, detected: bool, **more: Any) -> Answer:
    """The answer with a leading explanation and faults of the noise."""
    noise = tuple(noise)
    labels, *others = (tuple(sorted({*own, *noise})) for own in (best.labels, *best.equivalents))
    identical, powers = ([tuple(sorted({*own, *noise})) for own in sets] for sets in (best.identical, best.powers))
    if best.single_name:
        # A cause without a name that is not claimed is no part of the statement.
        others = [own for own in others if UNEXPLAINED not in own]
    more |= {"identical": tuple(identical), "powers": tuple(powers)}
    return Answer(labels, (labels, *others), best.probability, verdict, best.single_name, detected, **more)


def answer_of_diagnosis(diagnosis: "Diagnosis", **more: Any) -> Answer:
    """The answer that a diagnosis gives."""
    verdict = diagnosis.verdict
    return answer_of(diagnosis.best, diagnosis.noise_labels, verdict, verdict != "adequate", **more)


def right(best: "Explanation", truth: Labels, noise: Iterable[str] = ()) -> bool:
    """Whether the hidden set is the leading explanation or one of its equivalents, and no fault of the noise is reported."""
    return _against(truth, best, noise).right


def stated(best: "Explanation", truth: Labels, noise: Iterable[str] = ()) -> bool:
    """Whether the statement that has the probability is true."""
    return _against(truth, best, noise).stated


def with_unexplained(best: "Explanation", noise: Iterable[str] = ()) -> bool:
    """Whether the statement includes a cause without a name, and no fault of the noise is reported."""
    return _against((UNEXPLAINED,), best, noise).right


def sure(best: "Explanation") -> bool:
    """Whether one set is claimed with a probability above `SURE`."""
    return bool(best.labels and best.single_name and best.probability > SURE)


def _against(truth: Labels, best: "Explanation", noise: Iterable[str]) -> "Outcome":
    answer = answer_of(best, noise, "", bool(best.labels))
    return judged(Case("", 0, "", True, (truth,), None), answer)


@dataclass(frozen=True)
class Outcome:
    """A case judged.

    - `right`: the hidden set is in the stated class; for a cause that is in no catalogue, the class includes `unexplained`.
    - `strict`: it is the leading set; `alone`: it, or the same function at 1 g, is the only claim; `identified`: the verdict
      too.
    - `stated`: the statement that has the probability is true: sets that differ in the number of powers are one explanation;
      `wrong`: one other set is claimed with more than `SURE`.
    """

    kind: str
    number: int
    d: float
    plan: str
    known: bool
    truth: Labels
    labels: Labels
    classes: tuple[Labels, ...]
    verdict: str
    probability: float
    detected: bool
    right: bool
    strict: bool
    stated: bool
    alone: bool
    identified: bool
    wrong: bool
    crashed: bool
    words: str
    measures: dict[str, float]


def judged(case: Case, answer: Answer) -> Outcome:
    """Compare an answer with the truth."""
    accepted = case.accepted
    truth = accepted[0] if accepted else ()
    labels, identical = _without(answer.labels, case.excused), [_without(own, case.excused) for own in answer.identical]
    classes = tuple(_without(own, case.excused) for own in answer.classes)
    detected = bool(labels) if case.excused else answer.detected
    if (UNEXPLAINED,) in accepted:
        right = any(_unexplained(own, truth) or own in accepted for own in classes)
        strict = _unexplained(labels, truth) or labels in accepted
        stated = right
        alone = strict and (answer.verdict == UNEXPLAINED or UNEXPLAINED not in labels)
    elif not accepted:
        right = strict = stated = alone = False
    elif not truth:
        right = strict = stated = alone = not detected and not answer.crashed and not answer.refused
    else:
        right, strict = any(own in accepted for own in classes), labels in accepted
        alone = answer.single and right and (strict or any(own in accepted for own in identical))
        powers = [_without(own, case.excused) for own in answer.powers]
        stated = alone or any(own in accepted for own in powers) if answer.single else right
    if case.refusal and answer.refused:
        right = strict = stated = alone = True
    claimed = answer.single and bool(labels) and UNEXPLAINED not in labels and answer.probability > SURE
    return Outcome(
        kind=case.kind,
        number=case.number,
        d=case.d,
        plan=case.plan,
        known=case.known,
        truth=truth,
        labels=answer.labels,
        classes=answer.classes,
        verdict=answer.verdict,
        probability=answer.probability,
        detected=answer.detected,
        right=bool(right),
        strict=bool(strict),
        stated=bool(stated),
        alone=bool(alone),
        identified=bool(alone and answer.verdict == "identified"),
        wrong=bool(claimed and not stated),
        crashed=answer.crashed,
        words=answer.words,
        measures=answer.measures,
    )


def _without(labels: Labels, excused: Labels) -> Labels:
    return tuple(label for label in labels if not label.startswith(excused)) if excused else labels


def _unexplained(labels: Labels, truth: Labels) -> bool:
    """Whether these labels include a cause without a name, and no noise but the hidden one."""
    return UNEXPLAINED in labels and not any(own.startswith("noise_") and own not in truth for own in labels)


def interval(yes: int, of: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson)."""
    low, high = binomtest(int(yes), of).proportion_ci(method="wilson")
    return float(low), float(high)


def print_reliability(said: Iterable[tuple[float, bool]], bins: Sequence[float] = BINS) -> None:
    """Stated probabilities, each with whether it was right, with how often they were."""
    said = list(said)
    print("\nstated probability  statements  mean stated  right")
    for low, high in pairwise(bins):
        here = [own for own in said if low <= own[0] < high or own[0] == high == 1.0]
        if here:
            mean, share = np.mean(np.array(here, float), axis=0)
            print(f"{low:4.2f} to {high:4.2f} {len(here):17d} {mean:12.3f} {share:6.3f}")
