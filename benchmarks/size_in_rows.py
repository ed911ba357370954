"""Time and memory of `tumblecal calibrate` and `tumblecal diagnose` over the number of rows.

    python benchmarks/size_in_rows.py --rows 24 240 1000 2000 4000 10000

Writes passes through 4 x 12 attitudes (`--runs`: each pass is a run of its own; `--dense`: no attitude repeats), runs each
command twice, so that the second finds its programs compiled, and prints wall time, processor time and peak memory of the
second; what is refused is said.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tumblecal.data import PositionSet, write_positions


SIGMA = 1e-4


def position_set(rows: int, kind: str, seed: int = 3) -> PositionSet:
    """Simulated positions, a minute each."""
    rng = np.random.default_rng(seed)
    alpha = np.resize(np.tile(np.arange(12) * 30.0, 4), rows)
    beta = np.resize(np.repeat([0.0, 30.0, 60.0, 90.0], 12), rows)
    if kind == "dense":
        alpha = np.round(np.sort(rng.uniform(0, 360, rows)), 6)
    a, b = np.radians(alpha), np.radians(beta)
    g = np.stack([-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)], axis=1)
    matrix = np.eye(3) + np.array([[5e-4, 0, 0], [4e-4, -3e-4, 0], [-3e-4, 2e-4, 8e-4]])
    readings = g @ matrix.T + np.array([2e-3, -1.5e-3, 3e-3]) + SIGMA * rng.normal(size=(rows, 3))
    run = tuple(str(1 + row // 48) for row in range(rows)) if kind == "runs" else None
    names = tuple(f"p{row}" for row in range(rows))
    return PositionSet(names, alpha, beta, readings, run=run, time_s=60.0 * np.arange(rows))


def measured(command: list[str], limit_s: float) -> str:
    """Wall time, processor time and peak memory of a command, or why it did not finish."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    peak = "import resource, subprocess, sys; code = subprocess.run(sys.argv[1:]).returncode; "
    peak += "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss); sys.exit(code)"
    try:
        done = subprocess.run([sys.executable, "-c", peak, *command], capture_output=True, text=True, timeout=limit_s)
    except subprocess.TimeoutExpired:
        return f"more than {limit_s:.0f} s"
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        return f"exit {done.returncode}: {done.stderr.strip().splitlines()[-1]}"
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return f"{wall:6.1f} s wall {used:6.1f} s processor {int(done.stdout.split()[-1]) / 2**20:5.2f} GiB"


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--rows", type=int, nargs="+", default=[24, 240, 1000, 2000, 4000, 10000])
    arguments.add_argument("--commands", nargs="+", default=["calibrate", "diagnose"])
    arguments.add_argument("--limit", type=float, default=600.0, help="seconds of a command")
    kind = arguments.add_mutually_exclusive_group()
    kind.add_argument("--runs", dest="kind", action="store_const", const="runs", default="passes")
    kind.add_argument("--dense", dest="kind", action="store_const", const="dense")
    options = arguments.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ.setdefault("TUMBLECAL_CACHE", f"{folder}/cache")
        for rows in options.rows:
            path = Path(folder) / f"{options.kind}{rows}.csv"
            write_positions(path, position_set(rows, options.kind))
            for name in options.commands:
                command = [sys.executable, "-m", "tumblecal.cli", name, str(path), "--out", f"{folder}/{name}"]
                outcome = measured(command, options.limit)
                if "wall" in outcome:
                    outcome = measured(command, options.limit)
                print(f"{rows:6d} rows  {name:9s}  {outcome}", flush=True)


if __name__ == "__main__":
    main()
