"""How many files a second `tumblecal diagnose` does after the first, one process and two.

    python benchmarks/diagnosis_speed.py --files 120

Writes files of random instruments (24 and 48 positions, three of four with one hidden effect of 7 sigma, the noise stated in
half of them, by sd columns as measured: of every file, axis and position another), runs the command on a few and on all, and
prints the difference: start and compilation drop out.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.data import write_positions


FEW = 10
NAMES = list(blind.COEFFICIENTS)


def measured_sd(rng: np.random.Generator, positions: int) -> np.ndarray:
    """The sd columns of one file, g: each unit and axis has its own noise, each sd is that of the mean of a hundred samples."""
    level = blind.SIGMA * rng.uniform(0.7, 1.4) * rng.uniform(0.8, 1.25, 3)
    return level * np.sqrt(rng.chisquare(99, (positions, 3)) / 99)


def write_files(folder: Path, count: int, plan: tuple[int, int]) -> list[str]:
    """Position files; half of them, drawn at random, have sd columns."""
    rng, paths = np.random.default_rng(5), []
    while len(paths) < count:
        setup = blind.random_setup(rng, *plan)
        effects = {}
        if len(paths) % 4:
            name = NAMES[rng.integers(len(NAMES))]
            drawn = blind.sized(setup, blind.unreachable(setup), name, 7.0, rng)
            if drawn is None:
                continue
            effects = {name: drawn[0]}
        readings = blind.readings(setup, setup.nominal, effects)
        known = bool(rng.integers(2))
        sd = measured_sd(rng, len(readings)) if known else np.full(readings.shape, blind.SIGMA)
        positions = position_set(setup, readings + sd * rng.normal(size=sd.shape), known=known)
        path = folder / f"unit{len(paths):03d}.csv"
        write_positions(path, replace(positions, sd=sd) if known else positions)
        paths.append(str(path))
    return paths


def seconds(paths: list[str], out: Path, workers: int) -> float:
    """Wall time of the command."""
    started = time.perf_counter()
    command = [sys.executable, "-m", "tumblecal.cli", "diagnose", *paths, "--out", str(out), "--workers", str(workers)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - started


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--files", type=int, default=120)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    for name, plan in {"3x8": (3, 8), "4x12": (4, 12)}.items():
        with tempfile.TemporaryDirectory() as folder:
            paths = write_files(Path(folder), args.files, plan)
            for workers in (1, 2):
                rates = []
                seconds(paths[:2], Path(folder) / "warm", workers)
                for k in range(args.rounds):
                    few = seconds(paths[:FEW], Path(folder) / f"few{workers}{k}", workers)
                    every = seconds(paths, Path(folder) / f"all{workers}{k}", workers)
                    rates.append((len(paths) - FEW) / (every - few))
                low, high = min(rates), max(rates)
                print(f"{name}, {workers} process(es): {np.median(rates):.1f} files a second ({low:.1f} to {high:.1f})")


if __name__ == "__main__":
    main()
