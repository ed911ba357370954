"""Ablation of the diagnosis: which of its parts change answers, and are the changed answers better?

    python benchmarks/ablation.py run journal.jsonl --minutes 30
    python benchmarks/ablation.py table journal.jsonl

`run` goes round after round: it diagnoses one file of each kind of `simulated_files.py` as usual, then again without each
suspect of `ablation_suspects.py` that the file reaches (of the others the answers are equal by construction). Each answer is a
line of the journal, so that an interrupted run loses nothing and goes on. `table` prints Markdown, by suspect and simulator,
from the rounds that are complete for the suspect.

- reached: files in which the replacement gives another result somewhere. changed: another verdict or other leading names.
- lost, gained: answers that are right only with, and only without the suspect. difference: of the share of right answers of all
  files, without less with, with its 95 % interval (Agresti and Min 2005, for matched pairs).
- identified: right answers with that verdict. wrong, sure: another single name with a probability above 0.9.
"""

import argparse
import json
import time
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.stats import binomtest

from ablation_files import UNIT_KINDS, File, Units, files_of
from ablation_suspects import SUSPECTS, watched, without
from tumblecal.cli.start import start


# Suspects in the units taken together.
_OF_UNITS = ("two levels",)
# One in so many rounds has the units as well.
_UNITS_EVERY = 2


class Journal:
    """The lines of a file, by file and suspect ("": as usual)."""

    def __init__(self, path: Path):
        self._path, self.rows = path, {}
        if path.exists():
            for line in path.read_text().splitlines():
                row = json.loads(line) if line.endswith("}") else {}
                if row:
                    self.rows[row["file"], row["suspect"]] = row

    def add(self, row: dict) -> None:
        """Add a line."""
        self.rows[row["file"], row["suspect"]] = row
        with self._path.open("a") as file:
            file.write(json.dumps(row) + "\n")


def run(journal: Journal, seed: int, minutes: float, most_rounds: int) -> None:
    """Rounds until the time is over."""
    started, diagnosers = time.time(), {}
    for number in range(most_rounds):
        for words in _round(journal, seed, number, diagnosers):
            if words:
                print(f"round {number}, {time.time() - started:.0f} s: {words}", flush=True)
            if time.time() - started > 60 * minutes:
                return


def _round(journal: Journal, seed: int, number: int, diagnosers: dict) -> Iterator[str]:
    """One round, step by step."""
    with TemporaryDirectory() as folder:
        files: list[File | Units] = [*files_of(seed, number, Path(folder), diagnosers)]
    if number % _UNITS_EVERY == 0:
        files += [Units(kind, number, seed, diagnosers) for kind in UNIT_KINDS]
    for file in files:
        yield from _one(journal, file, number, "")
    yield f"{len(files)} files as usual"
    for suspect in SUSPECTS:
        reached = [file for file in files if suspect.name in journal.rows[file.key, ""]["reached"]]
        for file in reached:
            yield from _one(journal, file, number, suspect.name)
        yield f"{len(reached)} files without {suspect.name}"


def _one(journal: Journal, file: File | Units, number: int, suspect: str) -> Iterator[str]:
    """One line of the journal, if it is not there."""
    if (file.key, suspect) in journal.rows:
        return
    listed = [own for own in SUSPECTS if isinstance(file, File) or own.name in _OF_UNITS]
    chosen = next((own for own in SUSPECTS if own.name == suspect), None)
    with without(chosen) if chosen else nullcontext(), watched(() if chosen else listed) as reached:
        answer, seconds = file.answer()
    simulator, kind = (
        ("units", file.kind) if isinstance(file, Units) else (file.simulated.simulator, file.simulated.kind)
    )
    where = {"file": file.key, "simulator": simulator, "kind": kind, "round": number, "suspect": suspect}
    journal.add(where | asdict(answer) | {"said": list(answer.said), "seconds": seconds, "reached": sorted(reached)})
    yield ""


def pairs(journal: Journal, suspect: str) -> list[tuple[dict, dict]]:
    """With and without a suspect: of all files of the rounds that are complete for it."""
    usual = [row for (_, own), row in journal.rows.items() if not own]
    there = {file for file, own in journal.rows if own == suspect}
    incomplete = {row["round"] for row in usual if suspect in row["reached"] and row["file"] not in there}
    chosen = [row for row in usual if row["round"] not in incomplete]
    return [(row, journal.rows.get((row["file"], suspect), row)) for row in chosen]


def difference(lost: int, gained: int, files: int) -> tuple[float, float, float]:
    """Change of the share of right answers, matched pairs, with its 95 % interval (Agresti and Min 2005)."""
    b, c, n = lost + 0.5, gained + 0.5, files + 2
    middle, sd = (c - b) / n, np.sqrt(b + c - (c - b) ** 2 / n) / n
    return (gained - lost) / max(files, 1), float(middle - 1.96 * sd), float(middle + 1.96 * sd)


def table(journal: Journal) -> Iterator[str]:
    """Markdown: a row for each suspect and simulator."""
    heads = ("suspect", "lines", "simulator", "files", "reached", "changed", "lost", "gained", "sign test p",
             "difference / %", "identified", "wrong, sure", "CPU of reached files / s")  # fmt: skip
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for suspect in SUSPECTS:
        both = pairs(journal, suspect.name)
        simulators = ("units",) if suspect.name in _OF_UNITS else ("stress", "second", "in use", "all")
        for simulator in simulators:
            names = ("stress", "second", "in use") if simulator == "all" else (simulator,)
            own = [pair for pair in both if pair[0]["simulator"] in names]
            yield f"| {suspect.name} | {suspect.lines} | {simulator} | {_cells(own, suspect.name)} |"


def _cells(own: list[tuple[dict, dict]], suspect: str) -> str:
    reached = [pair for pair in own if suspect in pair[0]["reached"]]
    changed = [(a, b) for a, b in reached if (a["verdict"], a["said"]) != (b["verdict"], b["said"])]
    lost, gained = (sum(a["right"] == first and b["right"] != first for a, b in reached) for first in (True, False))
    p = binomtest(lost, lost + gained).pvalue if lost + gained else 1.0
    middle, low, high = (100 * value for value in difference(lost, gained, len(own)))
    counts = [
        f"{sum(a[what] for a, _ in own)} to {sum(b[what] for _, b in own)}" for what in ("identified", "wrong_sure")
    ]
    seconds = f"{sum(a['seconds'] for a, _ in reached):.1f} to {sum(b['seconds'] for _, b in reached):.1f}"
    cells = [
        len(own),
        len(reached),
        len(changed),
        lost,
        gained,
        f"{p:.2g}",
        f"{middle:+.2f} ({low:+.2f} to {high:+.2f})",
    ]
    return " | ".join(map(str, [*cells, *counts, seconds]))


def changes(journal: Journal, suspect: str) -> Iterator[str]:
    """The files whose answer changes without a suspect, a line each."""
    for a, b in pairs(journal, suspect):
        if (a["verdict"], a["said"], a["right"]) != (b["verdict"], b["said"], b["right"]):
            words = [
                f"{own['verdict']} {' + '.join(own['said'])} {own['probability']:.2f}{' right' * own['right']}"
                for own in (a, b)
            ]
            yield f"{a['file']}: {words[0]} -> {words[1]}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("run", "table", "changes"))
    parser.add_argument("journal", type=Path)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rounds", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=4501)
    parser.add_argument("--suspect", default="", help="of changes")
    asked = parser.parse_args()
    journal = Journal(asked.journal)
    if asked.command == "run":
        start()
        run(journal, asked.seed, asked.minutes, asked.rounds)
    else:
        print("\n".join(table(journal) if asked.command == "table" else changes(journal, asked.suspect)))


if __name__ == "__main__":
    main()
