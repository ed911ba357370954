"""Damaged files of every kind that tumblecal reads, through the commands that take them.

    python benchmarks/damaged_files.py --files 5000 --seed 1

A valid file is damaged (cut, bits flipped, bytes zeroed, doubled, inserted, lines lost or exchanged, cells replaced, another
encoding) and given to its command. The outcome is one of

- refused: exit code 2, nothing but lines of the program on stderr;
- reported: the command's numbers are others than those of the valid file, or fewer, and it printed a line that says so;
- the same: the numbers of the valid file;
- unseen: other numbers, where the format has nothing that shows the damage (another digit of a text is another number);
- SILENT: other numbers and no line, where the format shows the damage (`Kind.seen`);
- FAILED: a traceback, a warning of a library, output of native code, or numbers that are not finite.

The exit code is 1 when a file is SILENT or FAILED. `--part 2/5` runs a fifth; `--keep` keeps such files.
"""

import argparse
import collections
import random
import re
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import damaged_kinds
from damaged_kinds import Kind, numbers
from damaged_run import Outcome, ran
from spoilt_files import DAMAGES
from tumblecal.ground.errors import InputError
from tumblecal.ground.precision import enable_float64


WORDS = ("refused", "reported", "the same", "unseen", "SILENT", "FAILED")
_LONGEST_LINE = 2000
_SAYS = re.compile(
    "WARNING|left out|none in|lost|gap|jumps back|unit guessed|complete|restless|short|too few|Do not use|discarded"
)


@dataclass
class Trial:
    """What came of a file."""

    word: str
    told: str
    seconds: float


class Trials:
    """The kinds with what their valid files give."""

    def __init__(self, kinds: dict[str, Kind], folder: Path):
        self.kinds, self.folder = kinds, folder
        self.valid = dict[str, tuple[Outcome, list]]()

    def valid_of(self, name: str) -> tuple[Outcome, list]:
        """The outcome and the numbers of a kind's valid file."""
        if name not in self.valid:
            kind = self.kinds[name]
            outcome = self._outcome(kind, kind.content)
            assert outcome.code == 0 and not outcome.traceback, (name, outcome)
            self.valid[name] = outcome, self._numbers(kind, outcome)
        return self.valid[name]

    def _outcome(self, kind: Kind, content: bytes) -> Outcome:
        shutil.rmtree(self.folder, ignore_errors=True)
        for other, own in ({**kind.beside, kind.name: content}).items():
            path = self.folder / "in" / other
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(own)
        (self.folder / "out").mkdir()
        path = self.folder / "in" / kind.name
        if kind.words is not None:
            return ran(kind.words(path, self.folder / "in", self.folder / "out"))
        assert kind.read is not None
        try:
            kind.read(path)
        except InputError as error:
            return Outcome(2, "", "".join(f"tumblecal: {fault}\n" for fault in error.faults))
        except Exception:
            import traceback

            return Outcome(1, "", "", traceback.format_exc())
        return Outcome(0, "", "")

    def _numbers(self, kind: Kind, outcome: Outcome) -> list:
        found = [numbers(self.folder / "out" / name) for name in kind.results]
        return found or [re.sub(r"\S*/\S*", "", outcome.printed)]

    def trial(self, name: str, content: bytes) -> Trial:
        """Damage of a file of a kind."""
        kind = self.kinds[name]
        valid, before = self.valid_of(name)
        begin = time.monotonic()
        outcome = self._outcome(kind, content)
        word, told = self._word(kind, content, outcome, valid, before)
        return Trial(word, told, time.monotonic() - begin)

    def _word(self, kind: Kind, content: bytes, outcome: Outcome, valid: Outcome, before: list) -> tuple[str, str]:
        lines = outcome.told.splitlines()
        known = valid.told.splitlines()
        if outcome.traceback:
            return "FAILED", outcome.traceback
        alien = [line for line in lines if not line.startswith(("tumblecal: ", "WARNING: ")) and line not in known]
        if alien:
            return "FAILED", f"not a line of tumblecal: {alien[0][:300]}"
        if any(len(line) > _LONGEST_LINE for line in lines):
            return "FAILED", f"a line of {max(map(len, lines))} characters"
        if outcome.code == 2:
            return ("refused", "") if lines else ("FAILED", "refused without a word")
        if outcome.code not in (0, 1, 3):
            return "FAILED", f"exit code {outcome.code}"
        if missing := [name for name in kind.results if not (self.folder / "out" / name).exists()]:
            told = outcome.printed.strip() or "not a word"
            return ("refused", "") if outcome.code else ("FAILED", f"exit code 0 without {missing[0]}: {told[-300:]}")
        after = self._numbers(kind, outcome)
        if all(map(_same, before, after)):
            return "the same", ""
        said = [line for line in outcome.printed.splitlines() if _SAYS.search(line) and line not in valid.printed]
        lacking = [own for own in after if isinstance(own, np.ndarray) and not np.all(np.isfinite(own))]
        if lacking and "none in" not in outcome.printed:
            return "FAILED", f"not finite: {np.sum(~np.isfinite(lacking[0]))} numbers"
        if outcome.code != 0 or said or [line for line in lines if line not in known]:
            return "reported", ""
        return ("SILENT", "other numbers") if kind.seen(kind.content, content) else ("unseen", "")


def _same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.shape == other.shape and np.array_equal(one, other)
    return isinstance(one, str) and one == other


def run(count: int, seed: int, *, part: tuple[int, int] = (1, 1), only: str = "", keep: Path | None = None) -> dict:
    """Run; returns how many files of each kind came out how, and prints those that failed."""
    enable_float64()
    kinds = damaged_kinds.all_kinds()
    names = [name for name in kinds if only in name]
    counts, seen, slowest = collections.Counter(), collections.Counter(), (0.0, "", 0)
    with tempfile.TemporaryDirectory() as folder:
        trials = Trials(kinds, Path(folder) / "trial")
        for number in range(part[0] - 1, count, part[1]):
            chance = random.Random(f"{seed} {number}")
            name = names[number % len(names)]
            damage = chance.choice(DAMAGES)
            content = damage(kinds[name].content, chance)
            trial = trials.trial(name, content)
            slowest = max(slowest, (trial.seconds, name, number))
            counts[name, trial.word] += 1
            if trial.word in ("SILENT", "FAILED"):
                last = trial.told.strip().splitlines()[-1][:150]
                seen[name, damage.__name__, last] += 1
                if seen[name, damage.__name__, last] == 1:
                    print(f"{name}, file {number} ({damage.__name__}): {trial.told}", file=sys.stderr)
                    if keep:
                        keep.mkdir(parents=True, exist_ok=True)
                        (keep / f"{number}-{Path(kinds[name].name).name}").write_bytes(content)
    print(f"the slowest {slowest[0]:.2f} s ({slowest[1]}, file {slowest[2]})")
    for (name, damage, last), times in seen.most_common():
        print(f"  {times} {name}, {damage}: {last}")
    return {name: {word: counts[name, word] for word in WORDS} for name in names}


def main() -> int:
    """Run; exit code 1 when a file was taken silently or failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--files", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", default="1/1", help="2/5: the second fifth of the files")
    parser.add_argument("--kind", default="", help="only kinds with this in their name")
    parser.add_argument("--keep", type=Path, help="folder for the files that failed")
    options = parser.parse_args()
    first, parts = map(int, options.part.split("/"))
    begin = time.monotonic()
    table = run(options.files, options.seed, part=(first, parts), only=options.kind, keep=options.keep)
    print(f"{'kind':26} " + " ".join(f"{word:>9}" for word in WORDS))
    for name, row in [*table.items(), ("all", {word: sum(row[word] for row in table.values()) for word in WORDS})]:
        print(f"{name:26} " + " ".join(f"{row[word]:9d}" for word in WORDS))
    print(f"{time.monotonic() - begin:.0f} s")
    return 1 if any(row["SILENT"] or row["FAILED"] for row in table.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
