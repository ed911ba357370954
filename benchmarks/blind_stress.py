"""Position files as a user would have them, diagnosed through the command line: a simulator of `blind_study.py`.

Kinds are the conditions of `blind_conditions.py`, for which the diagnosis was not tuned: random instruments (plain numpy; plans
3 x 4, 3 x 8, 4 x 12, 5 x 16, noise stated or unknown, both at random). The files go through `tumblecal diagnose FILES
--out DIR`, and diagnosis.json is judged. A mistake must be rejected with an error message, or named and corrected.
"""

import json
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path

import numpy as np

from blind_conditions import CONDITIONS, drawn, write
from blind_judge import UNEXPLAINED, Answer, Case


KINDS = CONDITIONS


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """So many position files."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    for number in range(count):
        yield drawn(kind, rng, number)


def answered(cases: Iterable[Case]) -> Iterator[tuple[Case, Answer]]:
    """All cases of a kind by one command."""
    for _, group in groupby(cases, key=lambda case: case.kind):
        batch = list(group)
        with tempfile.TemporaryDirectory() as folder:
            files, out = [Path(folder) / f"unit{k:04d}.csv" for k in range(len(batch))], Path(folder) / "out"
            for file, case in zip(files, batch, strict=True):
                write(file, case.data)
            failed = diagnosed(files, out)
            for file, case in zip(files, batch, strict=True):
                refusal = failed.get(file, "").replace(str(file), file.name)
                record = None if refusal else json.loads(_record(file, out).read_text())
                yield case, answer_of_record(record, refusal)


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


def answer_of_record(record: dict | None, refusal: str) -> Answer:
    """The answer in diagnosis.json, or in an error message."""
    if record is None:
        crashed = refusal.startswith("crash")
        return Answer((), (), 0.0, "refused", False, True, words=refusal, refused=not crashed, crashed=crashed)
    best = record["explanations"][0] if record["explanations"] else {"equivalents": [], "probability": 0.0}
    labels, rivals = tuple(sorted(record["causes"])), record.get("noise_rivals", {})
    classes = [labels, *([tuple(sorted({rivals.get(name, name) for name in labels}))] if rivals else [])]
    classes += [tuple(sorted(name.replace(" at ", ":") for name in names)) for names in best["equivalents"]]
    # A set-up error that was corrected before the tests is reported with those that leave the same data.
    corrected = record.get("set_up", [])
    ids = {own["id"] for own in corrected}
    hypotheses = [ids, *(ids - {own["id"]} | {same["id"]} for own in corrected for same in own["equal"])]
    classes = [tuple(sorted({*names} - ids | others)) for names in classes for others in hypotheses]
    single = len(classes) == 1 and bool(labels) and UNEXPLAINED not in labels
    return Answer(
        labels,
        tuple(classes),
        best["probability"],
        record["verdict"],
        single,
        bool(labels),
        words=record["text"].partition("\n")[0],
    )
