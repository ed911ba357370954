"""The history's file: kill -9 while two processes write to it, and how long a long one takes to list.

python benchmarks/history_file.py [--kills 200] [--creations 150] [--rows 10000]

Two writers add entries to one new file and print the number of each one after `add` has returned; at a random moment one of
them is killed, then the other. Everything that was printed must be in the file, whole, and SQLite must find no fault in it.
Then four processes add to a file that is not there yet, at the same moment. Ends with code 1 where anything was lost or torn.
"""

import argparse
import os
import random
import resource
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from multiprocessing import Queue, get_context
from pathlib import Path
from threading import Barrier

import numpy as np

from tumblecal.data.sensor_parameters import MOUNT, SENSOR, SensorParameters
from tumblecal.ground.errors import InputError
from tumblecal.history.database import add, documents, listed, of_unit
from tumblecal.history.entry import Entry


NAMES = (*SENSOR, *MOUNT)
_AT_ONCE = 4


def entry(writer: str, number: int) -> Entry:
    """An entry whose parts all say which it is."""
    parameters = SensorParameters(NAMES, np.full(12, float(number)), np.eye(12) * (number + 1))
    text = f"{writer} {number} " * 2000  # several pages, so that a torn one would show
    date = f"2026-01-01T{number // 3600 % 24:02d}:{number // 60 % 60:02d}:{number % 60:02d}Z"
    return Entry(
        "calibration", writer, date, f"{number}", f"{number}", "converged", 1e-4, 0.5, parameters, {"result.json": text}
    )


def write(path: Path, writer: str) -> None:
    """Add entries until killed."""
    for number in range(1_000_000):
        add(path, entry(writer, number))
        print(number, flush=True)


def killed_once(folder: Path, wait_s: float) -> int:
    """Two writers, both killed: how many entries were acknowledged and are not there, or not whole."""
    path, process = folder / "lab.db", {}
    for writer in "ab":
        command = [sys.executable, __file__, "--write", str(path), "--writer", writer]
        process[writer] = subprocess.Popen(command, stdout=(folder / writer).open("w"))
    deadline = time.monotonic() + 600
    while any(not (folder / writer).read_text() for writer in "ab") and time.monotonic() < deadline:
        time.sleep(0.02)
    for own in process.values():
        time.sleep(wait_s / 2)
        own.send_signal(signal.SIGKILL)
        own.wait()
    bad = 0
    for writer in "ab":
        said = [int(line) for line in (folder / writer).read_text().split("\n")[:-1]]
        there = {int(e.source): e for e in of_unit(path, writer)}
        bad += len(set(said) - set(there)) + (not said)
        for number, kept in there.items():
            expected = entry(writer, number)
            whole = kept.parameters is not None and np.array_equal(kept.parameters.values, np.full(12, float(number)))
            bad += not (whole and documents(path, kept.number) == expected.documents)
    with sqlite3.connect(path) as database:
        bad += database.execute("PRAGMA integrity_check").fetchone()[0] != "ok"
    database.close()
    return bad


def add_at_once(paths: Queue, together: Barrier, faults: Queue) -> None:
    """Add an entry to each file, at the same moment as the other processes; tells what was refused."""
    for path in iter(paths.get, None):
        together.wait()
        try:
            add(path, entry(str(os.getpid()), 1))
            faults.put("")
        except InputError as fault:
            faults.put(str(fault))


def created_at_once(rounds: int, folder: Path) -> list[str]:
    """What was refused when several processes made a history at the same moment, or is not in it."""
    fork, told = get_context("fork"), []
    together, faults, paths = fork.Barrier(_AT_ONCE), fork.Queue(), [fork.Queue() for _ in range(_AT_ONCE)]
    workers = [fork.Process(target=add_at_once, args=(own, together, faults), daemon=True) for own in paths]
    for worker in workers:
        worker.start()
    for number in range(rounds):
        for own in paths:
            own.put(folder / f"{number}.db")
        told += [fault for fault in (faults.get(timeout=600) for _ in workers) if fault]
        if (count := len(listed(folder / f"{number}.db"))) != _AT_ONCE:
            told.append(f"{count} of {_AT_ONCE} entries")
    for own in paths:
        own.put(None)
    return told


def listing(rows: int, folder: Path) -> None:
    """Time the whole command on a long history, and its parts."""
    path = folder / "long.db"
    add(path, entry("a", 0))
    with sqlite3.connect(path) as database:
        columns = "kind, serial, date_utc, source, sha256, outcome, rms_g, p_value"
        numbers = f"WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n WHERE k < {rows - 1})"
        database.execute(f"{numbers} INSERT INTO entry (key, {columns}) SELECT k, {columns} FROM entry, n")
        for table in ("parameters", "document"):
            names = [row[1] for row in database.execute(f"PRAGMA table_info({table})")][1:]
            own = ", ".join(names)
            database.execute(
                f"INSERT INTO {table} SELECT entry.number, {own} FROM entry, {table} WHERE entry.number > 1"
            )
    database.close()
    times, before = [], resource.getrusage(resource.RUSAGE_CHILDREN)
    for _ in range(5):
        begun = time.perf_counter()
        command = [sys.executable, "-m", "tumblecal.cli", "history", str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        times.append(time.perf_counter() - begun)
    assert f"{rows} results" in done.stdout
    after, size = resource.getrusage(resource.RUSAGE_CHILDREN), path.stat().st_size / 1e6
    cpu = (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / len(times)
    wall = f"{np.median(times):.2f} s (median of 5), {cpu:.2f} s of a core"
    print(f"{rows} results ({size:.0f} MB) listed by the whole command in {wall}")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--creations", type=int, default=150)
    parser.add_argument("--rows", type=int, default=10_000)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--writer", default="a")
    arguments = parser.parse_args()
    if arguments.write:
        write(arguments.write, arguments.writer)
        return
    random.seed(1)
    bad = 0
    for _ in range((arguments.kills + 1) // 2):
        with tempfile.TemporaryDirectory() as name:
            bad += killed_once(Path(name), random.uniform(0.0, 0.3))
    print(f"{2 * ((arguments.kills + 1) // 2)} kills; lost or torn: {bad}")
    if arguments.creations:
        with tempfile.TemporaryDirectory() as name:
            refused = created_at_once(arguments.creations, Path(name))
        bad += len(refused)
        print(
            f"{arguments.creations} files made by {_AT_ONCE} processes at once; refused or lost: {len(refused)} {refused[:1]}"
        )
    if arguments.rows:
        with tempfile.TemporaryDirectory() as name:
            listing(arguments.rows, Path(name))
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
