"""Blind studies of the diagnosis: causes hidden in random instruments, diagnosed, and judged all by the same rule.

    python benchmarks/blind_study.py --list
    python benchmarks/blind_study.py --simulator catalogue --cases 148 --seed 461 --workers 2
    python benchmarks/blind_study.py --simulator stress --only "two, d" --only "unlisted*d = 10"

prints a table with a row for each kind of hidden cause (columns: `Outcome` in `blind_judge.py`), and how well the stated
probabilities hold. `--list` names the simulators and their kinds. `--only` takes part of a name, or a pattern with `*`; it may
be given several times. `--option` switches on what a simulator can do in addition (`rivals`, `screen`, `alone`).
"""

import argparse
import json
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from fnmatch import fnmatchcase
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from blind_judge import Outcome, interval, judged, print_reliability


# Modules with `KINDS`, `cases(kind, count, seed)`, `answered(cases, **options)` and perhaps `summary(outcomes)`.
SIMULATORS = {
    "catalogue": "blind_catalogue",
    "stress": "blind_stress",
    "noise": "blind_noise",
    "repeats": "blind_repeats",
    "units": "blind_units",
    "second": "second_study",
    "seeds": "blind_seeds",
}
COUNTED = ("detected", "right", "strict", "alone", "identified", "wrong")


def run(job: tuple[str, Sequence[str], int, int, Sequence[str]]) -> list[Outcome]:
    """All cases of some kinds of a simulator."""
    name, kinds, count, seed, options = job
    simulator = import_module(SIMULATORS[name])
    drawn = (case for kind in kinds for case in simulator.cases(kind, count, seed))
    return [judged(*both) for both in simulator.answered(drawn, **dict.fromkeys(options, True))]


def chosen(name: str, text: str) -> bool:
    """Whether a kind is one of those asked for."""
    return fnmatchcase(name, text) if "*" in text else text in name


def row(name: str, outcomes: Sequence[Outcome], measured: Sequence[str]) -> str:
    """A row of the table: counts, the share that is right with its interval, means of the measures."""
    low, high = interval(sum(own.right for own in outcomes), len(outcomes))
    counts = [str(sum(getattr(own, what) for own in outcomes)) for what in COUNTED]
    means = []
    for what in measured:
        values = [own.measures[what] for own in outcomes if what in own.measures]
        means.append(f"{np.median(values) if 'error' in what else np.mean(values):.3g}" if values else "")
    return f"| {' | '.join([name, str(len(outcomes)), *counts, f'{low:.1%} to {high:.1%}', *means])} |"


def words(own: Outcome) -> str:
    """One outcome in a line."""
    flag = "crash" if own.crashed else "wrong" if own.wrong else "" if own.right else "not in class"
    classes = ", ".join("+".join(labels) for labels in own.classes[1:5]) + (" .." if len(own.classes) > 5 else "")
    return (
        f"    {flag:12s} {own.kind}, case {own.number} ({own.plan}, noise {'stated' if own.known else 'unknown'}): "
        f"{'+'.join(own.truth)} -> {own.verdict} {own.probability:.2f} {'+'.join(own.labels)} [{classes}] {own.words}"
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--list", action="store_true", help="names of the simulators and their kinds only")
    parser.add_argument("--simulator", choices=SIMULATORS, default="catalogue")
    parser.add_argument("--only", action="append", default=[], help="kinds with this text in their name; repeatable")
    parser.add_argument("--cases", type=int, default=40, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--option", action="append", default=[], choices=("rivals", "screen", "alone"))
    parser.add_argument("--detail", action="store_true", help="list the cases that are not right, or not alone")
    parser.add_argument("--json", default="", help="file for all outcomes")
    args = parser.parse_args()
    if args.list:
        for name, module in SIMULATORS.items():
            print(name, *import_module(module).KINDS, sep="\n    ")
        return
    simulator = import_module(SIMULATORS[args.simulator])
    kinds = [name for name in simulator.KINDS if not args.only or any(chosen(name, text) for text in args.only)]
    if not kinds:
        parser.error(f"no kind is like {', '.join(args.only)}; --list shows all")
    started = time.time()
    if args.workers == 1:
        outcomes = run((args.simulator, kinds, args.cases, args.seed, args.option))
    else:
        jobs = [(args.simulator, [kind], args.cases, args.seed, args.option) for kind in kinds]
        with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
            outcomes = [outcome for done in pool.map(run, jobs) for outcome in done]
    report(outcomes, kinds, args.detail)
    if hasattr(simulator, "summary"):
        simulator.summary(outcomes)
    print(f"\n{len(outcomes)} cases in {time.time() - started:.0f} s")
    if args.json:
        Path(args.json).write_text(json.dumps([asdict(own) for own in outcomes], indent=1), encoding="utf-8")


def report(outcomes: Sequence[Outcome], kinds: Sequence[str], detail: bool) -> None:
    """The table, by kind and by plan, and the stated probabilities."""
    measured = list(dict.fromkeys(name for own in outcomes for name in own.measures))
    print(f"| {' | '.join(['hidden', 'cases', *COUNTED, 'right, 95 %', *measured])} |")
    print("|---" * (len(COUNTED) + len(measured) + 3) + "|")
    for kind in kinds:
        own = [outcome for outcome in outcomes if outcome.kind == kind]
        print(row(kind, own, measured))
        for outcome in own if detail else ():
            if not (outcome.right and outcome.alone):
                print(words(outcome))
    for plan in dict.fromkeys(outcome.plan for outcome in outcomes):
        print(row(f"*{plan}*", [outcome for outcome in outcomes if outcome.plan == plan], measured))
    print_reliability((own.probability, own.stated) for own in outcomes if own.detected and own.labels)


if __name__ == "__main__":
    main()
