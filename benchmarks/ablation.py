"""Ablation of the diagnosis: which of its parts change answers, and are the changed answers better?

    python benchmarks/ablation.py run journal.jsonl --minutes 30
    python benchmarks/ablation.py run outliers.jsonl --kind outlier --suspect positions
    python benchmarks/ablation.py table journal.jsonl

`run` goes round after round: it diagnoses one file of each kind of `simulated_files.py` as usual, then again without each
suspect of `ablation_suspects.py` that the file reaches (of the others the answers are equal by construction). Each answer is a
line of the journal, so that an interrupted run loses nothing and goes on. `table` prints Markdown, by suspect and simulator,
from the rounds that are complete for the suspect.

- reached: files in which the replacement gives another result somewhere. changed: another verdict or other leading names.
- lost, gained: answers that are right only with, and only without the suspect. difference: of the share of right answers of all
  files, without less with, with its 95 % interval (Agresti and Min 2005, for matched pairs).
- identified: right answers with that verdict. wrong, sure: another single name with a probability above 0.9.
- CPU: of the reached files, with and without, the watch of `reached` aside.
"""

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.stats import binomtest

from ablation_files import UNIT_KINDS, File, Units, files_of
from ablation_suspects import SUSPECTS, Suspect, watched, without
from tumblecal.cli.start import start


# Suspects in the units taken together.
_OF_UNITS = ("two levels",)
# Most files reach these: of a file that reaches no other the time is not compared.
_REACHED_BY_MOST = {"one curve", "sets of four causes", "patchwork", "setting changes", *_OF_UNITS}
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


@dataclass(frozen=True)
class Selection:
    """What is diagnosed: seed, texts of which a kind must have one (none: all kinds), suspects."""

    seed: int
    kinds: tuple[str, ...]
    suspects: tuple[Suspect, ...]

    def files(self, number: int, diagnosers: dict) -> list[File | Units]:
        """The files of a round."""
        with TemporaryDirectory() as folder:
            files: list[File | Units] = [*files_of(self.seed, number, Path(folder), diagnosers, self.kinds)]
        if number % _UNITS_EVERY == 0 and not self.kinds:
            files += [Units(kind, number, self.seed, diagnosers) for kind in UNIT_KINDS]
        return files


def run(journal: Journal, selection: Selection, minutes: float, most_rounds: int) -> None:
    """Rounds until the time is over."""
    started, diagnosers = time.time(), {}
    for number in range(most_rounds):
        for words in _round(journal, selection, number, diagnosers):
            if words:
                print(f"round {number}, {time.time() - started:.0f} s: {words}", flush=True)
            if time.time() - started > 60 * minutes:
                return


def _round(journal: Journal, selection: Selection, number: int, diagnosers: dict) -> Iterator[str]:
    """One round, step by step."""
    files = selection.files(number, diagnosers)
    for file in files:
        yield from _one(journal, file, number, None, selection.suspects)
    yield f"{len(files)} files as usual"
    for suspect in selection.suspects:
        reached = [file for file in files if suspect.name in journal.rows[file.key, ""]["reached"]]
        for file in reached:
            yield from _one(journal, file, number, suspect, ())
        yield f"{len(reached)} files without {suspect.name}"


def _one(
    journal: Journal, file: File | Units, number: int, suspect: Suspect | None, seen: Sequence[Suspect]
) -> Iterator[str]:
    """One line of the journal, if it is not there; `seen`: the suspects that are watched."""
    name = suspect.name if suspect else ""
    if (file.key, name) in journal.rows:
        return
    seen = [own for own in seen if isinstance(file, File) or own.name in _OF_UNITS]
    with without(suspect) if suspect else nullcontext(), watched(seen) as reached:
        answer, seconds = file.answer()
    if not reached <= _REACHED_BY_MOST:
        # What is watched takes longer.
        seconds = file.answer()[1]
    simulator, kind = (
        ("units", file.kind) if isinstance(file, Units) else (file.simulated.simulator, file.simulated.kind)
    )
    where = {"file": file.key, "simulator": simulator, "kind": kind, "round": number, "suspect": name}
    noted = {
        "said": list(answer.said),
        "seconds": seconds,
        "reached": sorted(reached),
        "watched": [own.name for own in seen],
    }
    journal.add(where | asdict(answer) | noted)
    yield ""


def pairs(journals: Sequence[Journal], suspect: str) -> list[tuple[dict, dict]]:
    """With and without a suspect: of all files of the rounds that are complete for it."""
    return [pair for journal in journals for pair in _pairs(journal, suspect)]


def _pairs(journal: Journal, suspect: str) -> list[tuple[dict, dict]]:
    usual = [row for (_, own), row in journal.rows.items() if not own and suspect in row["watched"]]
    there = {file for file, own in journal.rows if own == suspect}
    incomplete = {row["round"] for row in usual if suspect in row["reached"] and row["file"] not in there}
    chosen = [row for row in usual if row["round"] not in incomplete]
    return [(row, journal.rows.get((row["file"], suspect), row)) for row in chosen]


def difference(lost: int, gained: int, files: int) -> tuple[float, float, float]:
    """Change of the share of right answers, matched pairs, with its 95 % interval (Agresti and Min 2005)."""
    b, c, n = lost + 0.5, gained + 0.5, files + 2
    middle, sd = (c - b) / n, np.sqrt(b + c - (c - b) ** 2 / n) / n
    return (gained - lost) / max(files, 1), float(middle - 1.96 * sd), float(middle + 1.96 * sd)


def table(journals: Sequence[Journal], suspects: Sequence[Suspect]) -> Iterator[str]:
    """Markdown: a row for each suspect and simulator."""
    heads = ("suspect", "lines", "simulator", "files", "reached", "changed", "lost", "gained", "sign test p",
             "difference / %", "identified", "wrong, sure", "CPU / s")  # fmt: skip
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for suspect in suspects:
        both = pairs(journals, suspect.name)
        simulators = ("units",) if suspect.name in _OF_UNITS else ("stress", "second", "in use", "aimed", "all")
        for simulator in simulators:
            names = ("stress", "second", "in use", "aimed") if simulator == "all" else (simulator,)
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
    timed = [pair for pair in reached if not {*pair[0]["reached"]} <= _REACHED_BY_MOST]
    seconds = f"{sum(a['seconds'] for a, _ in timed):.1f} to {sum(b['seconds'] for _, b in timed):.1f}"
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


def changes(journals: Sequence[Journal], suspects: Sequence[Suspect]) -> Iterator[str]:
    """The files whose answer changes without a suspect, a line each."""
    for suspect in suspects:
        for a, b in pairs(journals, suspect.name):
            if (a["verdict"], a["said"], a["right"]) != (b["verdict"], b["said"], b["right"]):
                yield f"without {suspect.name}: {a['file']}: {_words(a)} -> {_words(b)}"


def _words(row: dict) -> str:
    return f"{row['verdict']} {' + '.join(row['said'])} {row['probability']:.2f}{' right' * row['right']}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("run", "table", "changes"))
    parser.add_argument("journals", type=Path, nargs="+", help="one for run; the others are added together")
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rounds", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=4501)
    parser.add_argument("--kind", action="append", default=[], help="only kinds of files with this text; repeatable")
    parser.add_argument("--suspect", action="append", default=[], help="only suspects with this text; repeatable")
    arguments = parser.parse_args()
    suspects = tuple(
        own for own in SUSPECTS if not arguments.suspect or any(text in own.name for text in arguments.suspect)
    )
    journals = [Journal(path) for path in arguments.journals]
    if arguments.command == "run":
        start()
        run(
            journals[0], Selection(arguments.seed, tuple(arguments.kind), suspects), arguments.minutes, arguments.rounds
        )
    else:
        print("\n".join(table(journals, suspects) if arguments.command == "table" else changes(journals, suspects)))


if __name__ == "__main__":
    main()
