"""The stress study: conditions that the diagnosis was not tuned for, run through the command line as a user would.

    python benchmarks/blind_stress.py --cases 20 --seed 1 --only "two, d" --only "unlisted*d = 10" --json stress.json

Position files of random instruments (plain numpy; plans 3 x 4, 3 x 8, 4 x 12, 5 x 16, noise stated or unknown, both at
random) go through `tumblecal diagnose FILES --out DIR`; diagnosis.json is read and judged:

- right: what is hidden is the best explanation or one of its equivalents, and nothing is said of the noise. A cause that
  is in no catalogue must be `unexplained`, or in a class with it; nothing hidden must be adequate; a mistake must be refused
  in words, or named and put right;
- strict: it is the best explanation itself;
- wrong, sure: another single set is named with a probability above 0.9.

At the end: how far the stated probabilities hold, over all conditions without mistakes.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from blind_conditions import CONDITIONS, PLANS, Case, drawn, write
from blind_judge import interval, print_reliability


BINS = (0.0, 0.3, 0.5, 0.7, 0.85, 0.9, 1.0)


@dataclass
class Judged:
    """One case and what was said of it. `said`: the causes of the best explanation; `crashed`: a traceback."""

    condition: str
    plan: str
    known: bool
    accepted: tuple[tuple[str, ...], ...]
    said: tuple[str, ...]
    verdict: str
    probability: float
    members: int
    right: bool
    strict: bool
    sure: bool
    crashed: bool
    words: str


def diagnosed(files: list[Path], out: Path) -> dict[Path, str]:
    """Run the command until every file was taken; returns what it said of those without a diagnosis.

    One that ends in a traceback takes the others with it: the command then runs again without it.
    """
    failed: dict[Path, str] = {}
    while waiting := [file for file in files if file not in failed and not _record(file, out).exists()]:
        # With a single file the results would lie in `out` itself.
        folder = out if len(waiting) > 1 else out / waiting[0].stem
        command = [sys.executable, "-m", "tumblecal.cli", "diagnose", *map(str, waiting), "--out", str(folder)]
        done = subprocess.run([*command, "--workers", "1", "--no-figures"], capture_output=True, text=True)
        told = done.stderr.strip().splitlines()
        for file in waiting:
            own = [line for line in told if str(file) in line]
            if not _record(file, out).exists() and own and done.returncode == 2:
                failed[file] = own[0]
        left = [file for file in waiting if file not in failed and not _record(file, out).exists()]
        if left:
            failed[left[0]] = f"crash ({done.returncode}): {told[-1] if told else ''}"
    return failed


def _record(file: Path, out: Path) -> Path:
    return out / file.stem / "diagnosis.json"


def judged(case: Case, record: dict | None, refusal: str) -> Judged:
    """Compare what was said with what was hidden."""
    mistake = CONDITIONS[case.condition].mistake
    said, verdict, probability, classes, words = (), "refused", 0.0, [], refusal
    if record is not None:
        best = record["explanations"][0] if record["explanations"] else {"equivalents": [], "probability": 0.0}
        said, verdict = tuple(sorted(record["causes"])), record["verdict"]
        words, probability = record["text"].partition("\n")[0], best["probability"]
        rivals = record.get("noise_rivals", {})
        classes = [said, *([tuple(sorted({rivals.get(name, name) for name in said}))] if rivals else [])]
        classes += [tuple(sorted(name.replace(" at ", ":") for name in names)) for names in best["equivalents"]]
        # What was put right before the test is told apart, with the slips that leave the same data.
        slips = record.get("set_up", [])
        ids = {slip["id"] for slip in slips}
        stories = [ids, *(ids - {slip["id"]} | {same["id"]} for slip in slips for same in slip["equal"])]
        classes = [tuple(sorted({*names} - ids | story)) for names in classes for story in stories]
    crashed = refusal.startswith("crash")
    if case.accepted and ("unexplained" in case.accepted[0]):
        noise = any(name.startswith("noise_") for name in said)
        strict = "unexplained" in said and not noise
        accepted = [names for names in classes if not any(name.startswith("noise_") for name in names)]
        right = any("unexplained" in names or names in case.accepted for names in accepted)
    else:
        right, strict = any(names in case.accepted for names in classes), said in case.accepted
    if mistake and record is None and not crashed:
        right = strict = True
    single = len(classes) == 1 and bool(said) and "unexplained" not in said
    return Judged(
        case.condition,
        case.plan,
        case.known,
        case.accepted,
        said,
        verdict,
        probability,
        len(classes),
        right,
        strict,
        bool(single and not right and probability > 0.9),
        crashed,
        words,
    )


def run(condition: str, count: int, seed: int) -> list[Judged]:
    """All cases of a condition."""
    rng = np.random.default_rng([seed, zlib.crc32(condition.encode())])
    cases = [drawn(condition, rng) for _ in range(count)]
    with tempfile.TemporaryDirectory() as folder:
        files, out = [Path(folder) / f"unit{k:04d}.csv" for k in range(count)], Path(folder) / "out"
        for file, case in zip(files, cases, strict=True):
            write(file, case.columns)
        failed = diagnosed(files, out)
        records = [None if file in failed else json.loads(_record(file, out).read_text()) for file in files]
        told = [failed.get(file, "").replace(str(file), file.name) for file in files]
        return [judged(*both) for both in zip(cases, records, told, strict=True)]


def chosen(name: str, text: str) -> bool:
    """Whether a condition is one of those asked for."""
    return fnmatchcase(name, text) if "*" in text else text in name


def line(name: str, cases: list[Judged]) -> str:
    """A row of the table."""
    cells = []
    for what in ("right", "strict", "sure"):
        yes = sum(getattr(case, what) for case in cases)
        low, high = interval(yes, len(cases))
        cells.append(f"{yes / len(cases):6.1%} ({low:5.1%} to {high:6.1%})")
    crashes = sum(case.crashed for case in cases)
    return f"{name:46s} {len(cases):5d}  {'  '.join(cells)}" + (f"  {crashes} tracebacks" if crashes else "")


def reliability(cases: Iterable[Judged]) -> None:
    """Stated probabilities beside how often they were right: all cases without a mistake in which something is said."""
    told = [case for case in cases if case.said and not CONDITIONS[case.condition].mistake]
    print_reliability([(case.probability, case.right) for case in told], BINS)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=20, help="of each condition")
    parser.add_argument("--seed", type=int, default=1)
    told = "conditions whose name holds this text, or is like it where it has a *; repeatable"
    parser.add_argument("--only", action="append", default=[], help=told)
    parser.add_argument("--detail", action="store_true", help="list what was not right")
    parser.add_argument("--list", action="store_true", help="only the names of the conditions")
    parser.add_argument("--json", default="", help="file for all cases")
    args = parser.parse_args()
    names = [name for name in CONDITIONS if not args.only or any(chosen(name, text) for text in args.only)]
    if not names:
        parser.error(f"no condition is like {', '.join(args.only)}; --list shows all")
    if args.list:
        print("\n".join(names))
        return
    started, cases = time.time(), []
    print(f"{'condition':46s} cases  right                     strict                    wrong and sure")
    for name in names:
        cases += (own := run(name, args.cases, args.seed))
        print(line(name, own), flush=True)
        for case in own if args.detail else ():
            if not case.right:
                hidden = " or ".join(map(str, case.accepted))
                print(f"    {case.plan} {hidden} -> {case.said} {case.probability:.2f} of {case.members}: {case.words}")
    print(f"\n{len(cases)} cases in {time.time() - started:.0f} s; by plan, without mistakes:")
    plain = [case for case in cases if not CONDITIONS[case.condition].mistake]
    for plan in PLANS:
        if own := [case for case in plain if case.plan == plan]:
            print(line(plan, own))
    reliability(cases)
    if args.json:
        Path(args.json).write_text(json.dumps([asdict(case) for case in cases], indent=1))


if __name__ == "__main__":
    main()
