"""Damaged files of every kind that tumblecal reads, through the commands that read them.

    python benchmarks/damaged_files.py --files 5000 --seed 1

A valid file is damaged (cut, bits flipped, bytes zeroed, doubled, inserted, lines lost or exchanged, cells replaced, another
encoding) and given to its command. The outcome is one of

- rejected: exit code 2, and only lines of the program on stderr;
- reported: different or fewer numbers, and a line that reports it;
- the same: the numbers of the valid file;
- unseen: different numbers, and nothing in the format shows the damage (another digit of a text is another number);
- SILENT: different numbers without a line, although the format shows the damage (`Kind.seen`);
- FAILED: a traceback, a warning of a library, output of native code, or numbers that are not finite.

The exit code is 1 if a file is SILENT or FAILED. `--kind`: a part of the names of kinds; `--keep`: folder for such files.
"""

import random
import re
import shutil
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path

import numpy as np

import damaged_kinds
from command_line import asked
from damaged_kinds import Kind, numbers
from in_process import Outcome, ran
from spoilt_files import DAMAGES
from tumblecal.ground.errors import InputError
from tumblecal.ground.precision import enable_float64


WORDS = ("rejected", "reported", "the same", "unseen", "SILENT", "FAILED")
_LONGEST_LINE = 2000
_REPORTS = re.compile(
    "WARNING|left out|none in|lost|gap|jumps back|unit guessed|complete|restless|short|too few|Do not use|discarded"
)


class Trials:
    """The kinds, with the outcome and the numbers of their valid files."""

    def __init__(self, kinds: dict[str, Kind], folder: Path):
        self.kinds, self.folder = kinds, folder
        self.valid: dict[str, tuple[Outcome, list]] = {}

    def _run(self, kind: Kind, content: bytes) -> Outcome:
        shutil.rmtree(self.folder, ignore_errors=True)
        source, out = self.folder / "in", self.folder / "out"
        for name, own in {**kind.others, kind.name: content}.items():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes(own)
        out.mkdir()
        if kind.read is None:
            return ran([word.format(file=source / kind.name, folder=source, out=out) for word in kind.command.split()])
        try:
            kind.read(source / kind.name)
        except InputError as error:
            return Outcome(2, "", "".join(f"tumblecal: {fault}\n" for fault in error.faults))
        except Exception:
            return Outcome(1, "", "", traceback.format_exc())
        return Outcome(0, "", "")

    def _numbers(self, kind: Kind, outcome: Outcome) -> list:
        found = [numbers(self.folder / "out" / name) for name in kind.results]
        return found or [re.sub(r"\S*/\S*", "", outcome.printed)]

    def trial(self, name: str, content: bytes) -> tuple[str, str]:
        """The outcome of a damaged file in a word, and the reason of a fault."""
        kind = self.kinds[name]
        if name not in self.valid:
            outcome = self._run(kind, kind.content)
            assert outcome.code == 0 and not outcome.traceback, (name, outcome)
            self.valid[name] = outcome, self._numbers(kind, outcome)
        valid, before = self.valid[name]
        outcome = self._run(kind, content)
        lines, known = outcome.told.splitlines(), valid.told.splitlines()
        foreign = [line for line in lines if not line.startswith(("tumblecal: ", "WARNING: ")) and line not in known]
        if outcome.traceback or foreign:
            return "FAILED", outcome.traceback or f"not a line of tumblecal: {foreign[0][:300]}"
        if any(len(line) > _LONGEST_LINE for line in lines):
            return "FAILED", f"a line of {max(map(len, lines))} characters"
        if outcome.code == 2:
            return ("rejected", "") if lines else ("FAILED", "rejected without a message")
        if outcome.code not in (0, 1, 3):
            return "FAILED", f"exit code {outcome.code}"
        if missing := [own for own in kind.results if not (self.folder / "out" / own).exists()]:
            fault = "FAILED", f"exit code 0 without {missing[0]}: {outcome.printed.strip()[-300:]}"
            return ("rejected", "") if outcome.code else fault
        after = self._numbers(kind, outcome)
        if all(map(_same, before, after)):
            return "the same", ""
        reports = [line for line in outcome.printed.splitlines() if _REPORTS.search(line) and line not in valid.printed]
        lacking = [own for own in after if isinstance(own, np.ndarray) and not np.all(np.isfinite(own))]
        if lacking and "none in" not in outcome.printed:
            return "FAILED", f"not finite: {np.sum(~np.isfinite(lacking[0]))} numbers"
        if outcome.code != 0 or reports or [line for line in lines if line not in known]:
            return "reported", ""
        return ("SILENT", "different numbers") if kind.seen(kind.content, content) else ("unseen", "")


def _same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.shape == other.shape and np.array_equal(one, other)
    return isinstance(one, str) and one == other


def main() -> int:
    """Run; print the table and each new fault."""
    given = asked(__doc__, files=5000, seed=1, kind="", keep=Path)
    enable_float64()
    kinds, counts, faults = damaged_kinds.all_kinds(), Counter(), Counter()
    names = [name for name in kinds if given.kind in name]
    with tempfile.TemporaryDirectory() as folder:
        trials = Trials(kinds, Path(folder) / "trial")
        for number in range(given.files):
            chance = random.Random(f"{given.seed} {number}")
            name, damage = names[number % len(names)], chance.choice(DAMAGES)
            content = damage(kinds[name].content, chance)
            word, reason = trials.trial(name, content)
            counts[name, word] += 1
            if word in ("SILENT", "FAILED"):
                fault = name, damage.__name__, reason.strip().splitlines()[-1][:150]
                faults[fault] += 1
                if faults[fault] == 1:
                    print(f"{name}, file {number} ({damage.__name__}): {reason}", file=sys.stderr)
                if faults[fault] == 1 and given.keep:
                    given.keep.mkdir(parents=True, exist_ok=True)
                    (given.keep / f"{number}-{Path(kinds[name].name).name}").write_bytes(content)
    for (name, damage, reason), times in faults.most_common():
        print(f"  {times} {name}, {damage}: {reason}")
    print(f"{'kind':26} " + " ".join(f"{word:>9}" for word in WORDS))
    for name in [*names, "all"]:
        row = [sum(counts[own, word] for own in (names if name == "all" else [name])) for word in WORDS]
        print(f"{name:26} " + " ".join(f"{count:9d}" for count in row))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
