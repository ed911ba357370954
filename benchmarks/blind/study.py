"""A population drawn, answered and judged: the table with a row for each kind of hidden cause.

`--list`: names of the kinds; `--only`: kinds with this text in their name; `--instruments`: of each kind; `--detail`: lists the
cases that are not right, or not alone.
"""

import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from fnmatch import fnmatchcase
from importlib import import_module
from multiprocessing import get_context

import numpy as np

from blind.judge import Outcome, interval, judged, print_reliability
from command_line import asked, print_head, print_row


# Modules with `KINDS`, `cases` (which draws them) and `answered`, and perhaps a `summary`.
POPULATIONS = {"catalogue": "blind.catalogue", "stress": "blind.conditions", "second": "blind.second"}
COUNTED = ("detected", "right", "strict", "alone", "identified", "wrong")
HEADS = ("hidden", "instruments", *COUNTED, "right, 95 %")


def run(job: tuple[str, Sequence[str], int, int]) -> list[Outcome]:
    """All cases of some kinds of a population."""
    name, kinds, count, seed = job
    own = import_module(POPULATIONS[name])
    drawn = (case for kind in kinds for case in own.cases(kind, count, seed))
    return [judged(*both) for both in own.answered(drawn)]


def chosen(name: str, text: str) -> bool:
    """Whether a kind is requested: by a part of its name, or by a pattern."""
    return fnmatchcase(name, text) if "*" in text else text in name


def print_counts(name: str, outcomes: Sequence[Outcome], measured: Sequence[str]) -> None:
    """Counts, the share that is right with its interval, and the measures: medians of errors, means of others."""
    low, high = interval(sum(own.right for own in outcomes), len(outcomes))
    counts = [str(sum(getattr(own, what) for own in outcomes)) for what in COUNTED]
    means = []
    for what in measured:
        values = [own.answer.measures[what] for own in outcomes if what in own.answer.measures]
        means.append(f"{np.median(values) if 'error' in what else np.mean(values):.3g}" if values else "")
    print_row(name, len(outcomes), *counts, f"{low:.1%} to {high:.1%}", *means)


def line(own: Outcome) -> str:
    """One outcome."""
    case, answer = own.case, own.answer
    flag = "crash" if own.crashed else "wrong" if own.wrong else "" if own.right else "not in class"
    classes = ", ".join("+".join(labels) for labels in answer.classes[1:5]) + (" .." if len(answer.classes) > 5 else "")
    truth = "+".join(case.accepted[0]) if case.accepted else "rejected"
    return (
        f"    {flag:12s} {case.kind}, case {case.number} ({case.plan}, noise {'stated' if case.known else 'unknown'}): "
        f"{truth} -> {answer.verdict} {answer.probability:.2f} {'+'.join(answer.labels)} [{classes}] {answer.words}"
    )


def report(outcomes: Sequence[Outcome], kinds: Sequence[str], detail: bool) -> None:
    """The table, by kind and by plan, and the stated probabilities."""
    measured = list(dict.fromkeys(name for own in outcomes for name in own.answer.measures))
    print_head(*HEADS, *measured)
    for kind in kinds:
        own = [outcome for outcome in outcomes if outcome.case.kind == kind]
        print_counts(kind, own, measured)
        for outcome in own if detail else ():
            if not (outcome.right and outcome.alone):
                print(line(outcome))
    for plan in dict.fromkeys(outcome.case.plan for outcome in outcomes):
        print_counts(f"*{plan}*", [outcome for outcome in outcomes if outcome.case.plan == plan], measured)
    print_reliability((own.answer.probability, own.stated) for own in outcomes if own.detected and own.answer.labels)


def main(name: str, words: Sequence[str]) -> None:
    """Draw, answer, judge and print."""
    given = asked(__doc__, words, list=False, only=[str], instruments=40, seed=1, workers=1, detail=False)
    own = import_module(POPULATIONS[name])
    kinds = [kind for kind in own.KINDS if not given.only or any(chosen(kind, text) for text in given.only)]
    if given.list or not kinds:
        print(*own.KINDS, sep="\n")
        return
    started = time.time()
    jobs = [(name, [kind], given.instruments, given.seed) for kind in kinds]
    if given.workers == 1:
        outcomes = run((name, kinds, given.instruments, given.seed))
    else:
        with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
            outcomes = [outcome for done in pool.map(run, jobs) for outcome in done]
    report(outcomes, kinds, given.detail)
    getattr(own, "summary", lambda outcomes: None)(outcomes)
    print(f"\n{len(outcomes)} instruments in {time.time() - started:.0f} s")
