"""Golden answers: the whole `diagnosis.json` of some 600 files, kept to compare another version of the program with.

    python benchmarks/golden_answers.py write /tmp/golden
    python benchmarks/golden_answers.py compare before/answers.jsonl.gz after/answers.jsonl.gz

`write` makes the files (`golden_calls.py`, fixed seeds) and gives them to `tumblecal diagnose` in this process. An interrupted
run goes on where it stopped. `--real FOLDER` adds the position files of a folder. The answers are one gzip file of JSON lines:
name, kind, digest of the file, answer (none for a refused file) and refusal. They are made again rather than committed.

`compare` lists, for each file in both, what differs (`golden_compare.py`), and counts by kind. Exit status 1 if anything does.
"""

import argparse
import gzip
import hashlib
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from golden_calls import Call, written
from golden_compare import compared, read, report


ANSWERS = "answers.jsonl.gz"


def answered(folder: Path, call: Call) -> tuple[str, int, float]:
    """Diagnose the files of a call and write the answers into `folder`, if not there already; name, files, seconds of CPU."""
    part, started = folder / f"{call.name}.jsonl.gz", time.process_time()
    if part.exists():
        return call.name, 0, 0.0
    with TemporaryDirectory() as temporary:
        out = Path(temporary) / "out"
        refused = _diagnosed(call, out)
        rows = [
            {
                "name": path.stem,
                "kind": kind,
                "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
                "answer": _answer(_folder(call, out, path)),
                "refused": refused.get(path, ""),
            }
            for path, kind in zip(call.files, call.kinds, strict=True)
        ]
        if "--units" in call.options:
            rows.append({"name": call.name, "kind": call.kinds[0], "sha256": "", "answer": _answer(out), "refused": ""})
    unfinished = part.with_suffix(".unfinished")
    with gzip.open(unfinished, "wt", encoding="utf-8") as file:
        file.writelines(json.dumps(row) + "\n" for row in rows)
    unfinished.replace(part)
    return call.name, len(rows), time.process_time() - started


def _diagnosed(call: Call, out: Path) -> dict[Path, str]:
    """Run the command until each file has a diagnosis or a refusal; the refusals. A file with a traceback is taken out."""
    from in_use import command

    refused: dict[Path, str] = {}
    while waiting := [path for path in call.files if path not in refused and _answer(_folder(call, out, path)) is None]:
        # A single file of a larger call is written where a batch would write it.
        own = _folder(call, out, waiting[0]) if len(waiting) == 1 else out
        code, words = 1, ""
        try:
            code, words = command("diagnose", *waiting, *call.options, "--out", own, "--no-figures", "--workers", 1)
        except Exception as error:
            words = f"crash: {type(error).__name__}: {error}"
        lines = [line for line in words.splitlines() if line.startswith(("tumblecal: ", "crash: "))]
        left = [path for path in waiting if _answer(_folder(call, out, path)) is None]
        named = {path: [line for line in lines if str(path) in line] for path in left}
        refused |= {path: own[0].replace(str(path), path.name) for path, own in named.items() if own and code == 2}
        if left and not any(path in refused for path in left):
            refused |= dict.fromkeys(left if code == 2 else left[:1], lines[-1] if lines else words[-200:])
    return refused


def _folder(call: Call, out: Path, path: Path) -> Path:
    return out / path.stem if len(call.files) > 1 else out


def _answer(folder: Path) -> dict | None:
    file = folder / "diagnosis.json"
    return json.loads(file.read_text()) if file.exists() else None


def write(folder: Path, real: Path | None, workers: int, only: str = "") -> Path:
    """Write the answers of this tree's program; returns their file. `only`: part of the names of the calls."""
    parts, answers, started = folder / "parts", folder / ANSWERS, time.time()
    parts.mkdir(parents=True, exist_ok=True)
    calls = [call for call in _calls(folder, real) if only in call.name]
    print(
        f"{sum(len(call.files) for call in calls)} files in {len(calls)} calls ({time.time() - started:.0f} s)",
        flush=True,
    )
    one = partial(answered, parts)
    if workers == 1:
        _progress(map(one, calls), len(calls), started)
    else:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            _progress(pool.map(one, calls), len(calls), started)
    # Members of a gzip file follow one another.
    unfinished = answers.with_suffix(".unfinished")
    unfinished.write_bytes(b"".join((parts / f"{call.name}.jsonl.gz").read_bytes() for call in calls))
    unfinished.replace(answers)
    return answers


def _calls(folder: Path, real: Path | None) -> list[Call]:
    """The calls, their files written by the first run into a folder."""
    listed = folder / "calls.json"
    if not listed.exists():
        calls = [vars(call) | {"files": [str(path) for path in call.files]} for call in written(folder / "files", real)]
        listed.write_text(json.dumps(calls))
    calls = json.loads(listed.read_text())
    return [
        Call(own["name"], tuple(map(Path, own["files"])), tuple(own["kinds"]), tuple(own["options"])) for own in calls
    ]


def _progress(done, count: int, started: float) -> None:
    for number, (name, files, seconds) in enumerate(done, start=1):
        words = f"{files} answers, {seconds:.1f} s of CPU" if files else "there already"
        print(f"{number} of {count}  {name}: {words}; {time.time() - started:.0f} s in all", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    writing = commands.add_parser("write", help="diagnose all files")
    writing.add_argument("folder", type=Path)
    writing.add_argument("--real", type=Path, help="folder with further position files")
    writing.add_argument("--workers", type=int, default=1)
    writing.add_argument("--only", default="", help="only calls with this in their names, such as 'batch 03' or units")
    comparing = commands.add_parser("compare", help="compare two files of answers")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    asked = parser.parse_args()
    if asked.command == "write":
        answers = write(asked.folder, asked.real, asked.workers, asked.only)
        print(f"written: {answers}: {len(read(answers))} answers, {answers.stat().st_size / 1e6:.1f} MB")
        return 0
    differences = compared(read(asked.before), read(asked.after))
    print(report(differences))
    return int(any(own.changed for own in differences))


if __name__ == "__main__":
    sys.exit(main())
