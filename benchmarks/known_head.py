"""What a measured head is worth to later calibrations on it.

    python benchmarks/known_head.py --later 40

Units of the blind instrument (plain numpy, 24 positions, stated noise 0.1 mg) on one head with two errors of its own. Some are
diagnosed together (`tumblecal diagnose --units`); later ones are calibrated without and with the `head.toml` so made. Printed:
rms error of the sensor's parameters, without and with, their ratio, and the rms error in stated sd (1 where intervals hold).
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind_noise import position_set  # noqa: E402
from tumblecal.data import write_positions  # noqa: E402


NAMES = ("dK_x", "dK_y", "dK_z", "bias_x", "bias_y", "bias_z", "gamma_21", "gamma_31", "gamma_32")
# rad: each 2 to 4 sigma in one unit.
HEAD = {"base_levelling": np.array([1.2e-4]), "index_eccentricity": np.array([1.2e-4, -0.8e-4])}
PITCH = np.array([1.2e-3, -2.1e-3, 0.8e-3])


def write_unit(path: Path, rng: np.random.Generator, common_pitch: bool) -> np.ndarray:
    """One unit's file; returns the true parameters of its sensor."""
    setup = blind.random_setup(rng, 3, 8)
    if common_pitch:
        setup.nominal["dbeta"] = PITCH
    readings = blind.readings(setup, setup.nominal, HEAD)
    readings = readings + blind.SIGMA * rng.normal(size=readings.shape)
    write_positions(path, position_set(setup, readings, known=True))
    return np.concatenate([setup.nominal[name] for name in ("dK", "bias", "gamma")])


def command(*arguments: object) -> None:
    subprocess.run([sys.executable, "-m", "tumblecal.cli", *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def errors(files: list[Path], truth: np.ndarray, out: Path, *options: object) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the sensor's parameters (units, parameters), and the same in stated sd."""
    command("calibrate", *files, "--out", out, *options)
    values, sd = [], []
    for file in files:
        found = json.loads((out / file.stem / "result.json").read_text())["methods"]["exact"]["parameters"]
        values.append([found[name]["value"] for name in NAMES])
        sd.append([found[name]["sd"] for name in NAMES])
    return np.array(values) - truth, (np.array(values) - truth) / np.array(sd)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--units", type=int, default=8, help="units that the head is measured with")
    parser.add_argument("--later", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    for title, common in (("pitch errors of the head", True), ("pitch set anew for each unit", False)):
        rng = np.random.default_rng([args.seed, common])
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            first = [folder / f"unit{k}.csv" for k in range(args.units)]
            for file in first:
                write_unit(file, rng, common)
            command("diagnose", "--units", *first, "--out", folder / "batch")
            named = json.loads((folder / "batch" / "diagnosis.json").read_text())["explanations"][0]["effects"]
            later = [folder / f"later{k}.csv" for k in range(args.later)]
            truth = np.array([write_unit(file, rng, common) for file in later])
            alone, alone_sd = errors(later, truth, folder / "alone")
            beside, beside_sd = errors(later, truth, folder / "beside", "--head", folder / "batch" / "head.toml")
        print(f"{title}: head measured with {args.units} units, {' + '.join(named)}; {args.later} later ones")
        print(f"{'':10s} rms error / 1e-6   with head   ratio   in stated sd   with head")
        rms = lambda values: np.sqrt(np.mean(values**2, axis=0))  # noqa: E731
        columns = rms(alone) * 1e6, rms(beside) * 1e6, rms(beside) / rms(alone), rms(alone_sd), rms(beside_sd)
        for label, *cells in zip(NAMES, *columns, strict=True):
            print(f"{label:10s} {cells[0]:16.1f} {cells[1]:11.1f} {cells[2]:7.2f} {cells[3]:14.2f} {cells[4]:11.2f}")
        print(flush=True)


if __name__ == "__main__":
    main()
