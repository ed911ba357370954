"""The history's file: kill -9 while two processes write to it.

python benchmarks/history_file.py [--kills 200] [--creations 150]

Two writers add entries to one new file and print the number of each one after `add` has returned; at a random moment one of
them is killed, then the other. Everything that was printed must be in the file, whole, and SQLite must find no fault in it.
Then four processes add to a file that is not there yet, at the same moment. Ends with code 1 where anything was lost or torn.
"""

import os
import random
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

from command_line import asked
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
            bad += not (whole and documents(path, kept.number) == (expected.documents, []))
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


def main() -> None:
    arguments = asked(__doc__, kills=200, creations=150, write=Path, writer="a")
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
        made = f"{arguments.creations} files made by {_AT_ONCE} processes at once"
        print(f"{made}; refused or lost: {len(refused)} {refused[:1]}")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
