"""Wall time, processor time and peak memory of commands, each as a process of its own.

    python benchmarks/command_speed.py start                     `calibrate` against a script with numpy and scipy, in turns
    python benchmarks/command_speed.py rows --rows 48 240 1000   `calibrate` and `diagnose` over the number of rows
    python benchmarks/command_speed.py files --files 100         files per second of `diagnose`, one process and two
    python benchmarks/command_speed.py hand_held --rows 40       a hand-held log of a million rows (text, 1 kHz), 40 positions
    python benchmarks/command_speed.py apply --rows 20000000     `apply` next to copying and plain numpy

A first run of a command compiles its programs; the printed one finds them. On a busy machine only the processor time counts.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from importlib.resources import files as resources
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import monotonic
from typing import NamedTuple

from command_line import asked


HERE = Path(__file__).parent
TUMBLECAL = (sys.executable, "-m", "tumblecal.cli")
TABLE1 = str(resources("tumblecal.data.paper") / "table1.csv")
# Reports the peak memory of a command: the system counts the memory of this process into that of its children.
PEAK = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=sys.stderr).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
sys.exit(code)
"""
AXES = ("ax_g", "ay_g", "az_g")
# The ways of `apply`: arguments of the command, or a program.
WAYS = {
    "copy": "pl.scan_parquet('log.parquet').sink_parquet('out.parquet', compression='lz4')",
    "copy, uncompressed": "pl.scan_parquet('log.parquet').sink_parquet('out.parquet', compression='uncompressed')",
    "copy, zstd": "pl.scan_parquet('log.parquet').sink_parquet('out.parquet', compression='zstd')",
    "numpy": """
frame = pl.read_parquet('log.parquet')
force = (np.column_stack([frame[axis].to_numpy() for axis in AXES]) - own.bias) @ own.matrix.T
columns = [pl.Series(axis, force[:, k]) for k, axis in enumerate(AXES)]
frame.with_columns(columns).write_parquet('out.parquet', compression='lz4')""",
    "apply": ("apply", "linear.json", "log.parquet", "--out", "out.parquet"),
    "apply with two terms": ("apply", "terms.json", "log.parquet", "--out", "out.parquet"),
    "apply, text": ("apply", "linear.json", "log.csv", "--out", "out.csv"),
}
IMPORTS = f"""
import numpy as np, polars as pl
from tumblecal.data.calibration import read_calibration
own, AXES = read_calibration(__import__('pathlib').Path('linear.json')), {AXES}
"""


class Used(NamedTuple):
    """Wall time and processor time, s, and peak memory, MB."""

    wall: float
    cpu: float
    peak: float

    def __str__(self) -> str:
        return f"{self.wall:8.2f} s wall {self.cpu:8.2f} s processor {self.peak:7.0f} MB"


def used(command: Sequence[object], folder: Path | str = ".") -> Used:
    """Time and memory of a command."""
    begin = monotonic()
    done = subprocess.run([sys.executable, "-c", PEAK, *map(str, command)], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}: {done.stderr[-500:]}")
    return Used(monotonic() - begin, *map(float, done.stdout.split()))


def start(given: argparse.Namespace, folder: Path) -> None:
    """Cold start on Table 1, pair by pair; the first run ever has an empty cache of programs."""
    ours = (*TUMBLECAL, "calibrate", TABLE1, "--no-figures", "--out", folder / "out")
    plain = (sys.executable, HERE / "scipy_fit.py", TABLE1)
    first = used(ours)
    pairs = [(used(ours).wall, used(plain).wall) for _ in range(given.repeats)]
    ratios = [a / b for a, b in pairs]
    print(f"tumblecal calibrate: median {median(a for a, _ in pairs):.2f} s (first ever {first.wall:.2f} s)")
    print(f"numpy and scipy:     median {median(b for _, b in pairs):.2f} s")
    print(f"ratio: median {median(ratios):.2f}, {min(ratios):.2f} to {max(ratios):.2f} (required: at most 4)")


def rows(given: argparse.Namespace, folder: Path) -> None:
    """Passes through 4 x 12 orientations."""
    import numpy as np

    from tumblecal.data import PositionSet, write_positions

    matrix = np.eye(3) + np.array([[5e-4, 0, 0], [4e-4, -3e-4, 0], [-3e-4, 2e-4, 8e-4]])
    for count in given.rows or (48, 240, 1000, 2000, 4000, 10000):
        rng = np.random.default_rng(1)
        grid = np.tile(np.arange(12) * 30.0, 4), np.repeat([0.0, 30, 60, 90], 12)
        alpha, beta = (np.resize(angles, count) for angles in grid)
        a, b = np.radians(alpha), np.radians(beta)
        force = np.stack([-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)], axis=1)
        readings = force @ matrix.T + [2e-3, -1.5e-3, 3e-3] + 1e-4 * rng.normal(size=(count, 3))
        data = PositionSet(
            tuple(f"p{row}" for row in range(count)), alpha, beta, readings, time_s=60.0 * np.arange(count)
        )
        path = folder / f"rows{count}.csv"
        write_positions(path, data)
        for name in ("calibrate", "diagnose"):
            command = (*TUMBLECAL, name, path, "--out", folder / name)
            used(command)
            print(f"{count:6d} rows  {name:9s} {used(command)}", flush=True)


def files(given: argparse.Namespace, folder: Path) -> None:
    """Random instruments, three of four with an effect of 7 sigma; sd columns as measured in half of the files.

    The time of ten files is subtracted, so start and compilation drop out.
    """
    from dataclasses import replace

    import numpy as np

    import blind_instrument as blind
    from blind_noise import position_set
    from tumblecal.data import write_positions

    names = list(blind.COEFFICIENTS)
    for plan in ((3, 8), (4, 12)):
        rng, paths = np.random.default_rng(5), []
        while len(paths) < given.files:
            setup, effects = blind.random_setup(rng, *plan), {}
            if len(paths) % 4:
                name = names[rng.integers(len(names))]
                drawn = blind.sized(setup, blind.unreachable(setup), name, 7.0, rng)
                if drawn is None:
                    continue
                effects = {name: drawn[0]}
            readings = blind.readings(setup, setup.nominal, effects)
            level = blind.SIGMA * rng.uniform(0.7, 1.4) * rng.uniform(0.8, 1.25, 3)
            sd = level * np.sqrt(rng.chisquare(99, readings.shape) / 99)
            data = position_set(setup, readings + sd * rng.normal(size=sd.shape), known=bool(rng.integers(2)))
            paths.append(folder / f"{plan[0]}x{plan[1]} {len(paths):03d}.csv")
            write_positions(paths[-1], replace(data, sd=sd) if data.sd is not None else data)
        for workers in (1, 2):
            command = (*TUMBLECAL, "diagnose", "--workers", workers, "--out", folder / f"out{workers}")
            used((*command, *paths[:2]))
            rates = [
                (len(paths) - 10) / (used((*command, *paths)).wall - used((*command, *paths[:10])).wall)
                for _ in range(given.repeats)
            ]
            print(f"{plan[0]}x{plan[1]}, {workers} process(es): {median(rates):.1f} files per second", flush=True)


def hand_held(given: argparse.Namespace, folder: Path) -> None:
    """From the log to the verdict; the programs are compiled by a different log of as many positions."""
    for positions in given.rows or (40,):
        for seed in (2, 1):
            log, means = folder / f"million{seed}.csv", folder / f"reduced{seed}"
            make = f"from hand_held_sessions import write_log; write_log({str(log)!r}, {positions}, {seed})"
            subprocess.run([sys.executable, "-c", make], check=True, cwd=HERE, stdout=subprocess.DEVNULL)
            reduce = ("reduce", log, "--static", "--gravity", "9.80665", "--out", means)
            diagnose = ("diagnose", means / "positions.csv", "--out", folder / "diagnosis")
            for name, *words in (reduce, diagnose):
                result = used((*TUMBLECAL, name, *words, *(() if given.figures else ("--no-figures",))))
                if seed == 1:
                    print(f"{positions} positions  {name:9s} {result}", flush=True)


def apply(given: argparse.Namespace, folder: Path) -> None:
    """Samples as float64, with time and temperature; a tenth of them as text. The start of Python is included."""
    import numpy as np
    import polars as pl

    from tumblecal.data.calibration import Calibration, write_calibration

    count, rng = (given.rows or (20_000_000,))[0], np.random.default_rng(1)
    columns = {"time_s": np.arange(count) / 1000, **{name: rng.normal(size=count) * 0.3 for name in AXES}}
    frame = pl.DataFrame(columns | {"temperature_degc": 20 + np.arange(count) / count})
    frame.write_parquet(folder / "log.parquet", row_group_size=1 << 20)
    frame[: count // 10].write_csv(folder / "log.csv")
    terms = [
        {"axis": "x", "coefficient": 1e-4, "powers": [0, 0, 0], "per_degc": True, "reference_degc": 25.0},
        {"axis": "z", "coefficient": 3e-4, "powers": [0, 0, 2]},
    ]
    matrix, bias = np.eye(3) + 0.01 * np.random.default_rng(0).normal(size=(3, 3)), np.array([0.02, -0.03, 0.05])
    for name, extra in {"linear": {}, "terms": {"extra": {"terms": terms}}}.items():
        write_calibration(folder / f"{name}.json", Calibration(matrix, bias, np.zeros((12, 12)), **extra))
    copied, results = 0.0, {}
    for name, way in WAYS.items():
        command = (sys.executable, "-c", IMPORTS + way) if isinstance(way, str) else (*TUMBLECAL, *way, "--use-anyway")
        best = min((used(command, folder) for _ in range(given.repeats)), key=lambda own: own.cpu)
        copied = copied or best.cpu
        rows_read = count // 10 if name.endswith("text") else count
        print(
            f"{name:22s} {best} {rows_read / best.wall:10.3g} rows/s {best.cpu / copied:6.2f} CPU of copy", flush=True
        )
        if name in ("numpy", "apply"):
            results[name] = pl.read_parquet(folder / "out.parquet", columns=list(AXES)).to_numpy()
    print(f"largest difference to numpy: {np.abs(results['numpy'] - results['apply']).max():.1e} g")


def main() -> None:
    """One of the parts."""
    parts = ("start", "rows", "files", "hand_held", "apply")
    given = asked(__doc__, part=parts, rows=[int], files=120, repeats=3, figures=False)
    with TemporaryDirectory() as folder:
        os.environ.setdefault("TUMBLECAL_CACHE", f"{folder}/cache")
        globals()[given.part](given, Path(folder))


if __name__ == "__main__":
    main()
