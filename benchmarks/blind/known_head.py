"""The population `head`: what a measured head is worth to later calibrations on it.

    python benchmarks/blind head --later 40

Units of the blind instrument (24 positions, stated noise 0.1 mg) on one head with two errors. Some are diagnosed together
(`tumblecal diagnose --units`); later ones are calibrated without and with the `head.toml` so made. Printed for each
parameter of the sensor: rms error without and with, their ratio, and the rms error in standard uncertainties.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind_noise import position_set  # noqa: E402
from tumblecal.data import write_positions  # noqa: E402
from tumblecal.data.sensor_parameters import SENSOR  # noqa: E402


# rad: each 2 to 4 sigma in one unit.
HEAD = {"base_levelling": np.array([1.2e-4]), "index_eccentricity": np.array([1.2e-4, -0.8e-4])}
PITCH = np.array([1.2e-3, -2.1e-3, 0.8e-3])


def write_unit(path: Path, rng: np.random.Generator, common_pitch: bool) -> list[float]:
    """Write one unit's file; the true dK, bias and gamma of its sensor."""
    setup = blind.random_setup(rng, 3, 8)
    if common_pitch:
        setup.nominal["dbeta"] = PITCH
    readings = blind.readings(setup, setup.nominal, HEAD)
    write_positions(path, position_set(setup, readings + blind.SIGMA * rng.normal(size=readings.shape), known=True))
    names = [f"{leaf}_{axis}" for leaf in ("dK", "bias") for axis in "xyz"] + ["gamma_21", "gamma_31", "gamma_32"]
    values = np.concatenate([setup.nominal[name] for name in ("dK", "bias", "gamma")])
    return [values[names.index(name)] for name in SENSOR]


def command(*arguments: object) -> None:
    subprocess.run([sys.executable, "-m", "tumblecal.cli", *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def rms_errors(files: list[Path], truth: np.ndarray, out: Path, *options: object) -> np.ndarray:
    """Rms errors of the parameters of the sensor (2, 9): in their unit, and in standard uncertainties."""
    command("calibrate", *files, "--out", out, *options)
    found = [
        json.loads((out / file.stem / "result.json").read_text())["methods"]["exact"]["parameters"] for file in files
    ]
    values, u = (np.array([[own[name][key] for name in SENSOR] for own in found]) for key in ("value", "sd"))
    return np.sqrt(np.mean(np.stack([values - truth, (values - truth) / u]) ** 2, axis=1))


def main(words: Sequence[str]) -> None:
    """Measure the head, calibrate the later units, print."""
    parser = argparse.ArgumentParser(prog="blind head")
    parser.add_argument("--units", type=int, default=8, help="with which the head is measured")
    parser.add_argument("--later", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args(words)
    for title, common in (("pitch errors of the head", True), ("pitch set again for each unit", False)):
        rng = np.random.default_rng([asked.seed, common])
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            first = [folder / f"unit{k}.csv" for k in range(asked.units)]
            for file in first:
                write_unit(file, rng, common)
            command("diagnose", "--units", *first, "--out", folder / "batch")
            named = json.loads((folder / "batch" / "diagnosis.json").read_text())["explanations"][0]["effects"]
            later = [folder / f"later{k}.csv" for k in range(asked.later)]
            truth = np.array([write_unit(file, rng, common) for file in later])
            alone = rms_errors(later, truth, folder / "alone")
            known = rms_errors(later, truth, folder / "known", "--head", folder / "batch" / "head.toml")
        print(f"\n{title}: measured with {asked.units} units, {' + '.join(named)}; {asked.later} later ones\n")
        print(
            "| parameter | rms error / 1e-6 | with head | ratio | rms error / u | with head |\n|---|---|---|---|---|---|"
        )
        for k, label in enumerate(SENSOR):
            cells = 1e6 * alone[0, k], 1e6 * known[0, k], known[0, k] / alone[0, k], alone[1, k], known[1, k]
            print(
                f"| {label} | {cells[0]:.1f} | {cells[1]:.1f} | " + " | ".join(f"{own:.2f}" for own in cells[2:]) + " |"
            )
