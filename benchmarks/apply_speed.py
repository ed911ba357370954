"""How fast `tumblecal apply` corrects Parquet and text, beside the same formula in plain numpy and in Polars.

    python benchmarks/apply_speed.py --rows 20000000

Prints rows a second by wall clock and by processor time, and the peak memory of each step (a process of its own, the best of
`--repeats`). "read" reads pieces and drops them, "correct" does all that `apply` does but writing, "copy" is Polars from file
to file without a change: what they take of the processor time of `apply` is what reading, checks with arithmetic, and writing
take. "numpy" reads the whole file, computes and writes it whole; "polars" is the formula as one lazy query from file to file. A
machine busy with other work tells only the processor time.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl


MATRIX = np.eye(3) + 0.01 * np.random.default_rng(0).normal(size=(3, 3))
BIAS = np.array([0.02, -0.03, 0.05])
TERMS = [
    {"axis": "x", "coefficient": 1e-4, "powers": [0, 0, 0], "per_degc": True, "reference_degc": 25.0},
    {"axis": "z", "coefficient": 3e-4, "powers": [0, 0, 2]},
]
AXES = ("ax_g", "ay_g", "az_g")
STEPS = (
    *("read", "correct", "copy", "copy, uncompressed", "copy, zstd", "numpy", "polars"),
    *("apply", "apply with two terms", "apply, text"),
)


def recording(folder: Path, rows: int) -> None:
    """Samples as float64, with time and temperature, in row groups as most programs write them; a tenth of it as text."""
    from tumblecal.data.calibration import Calibration, write_calibration

    rng = np.random.default_rng(1)
    frame = pl.DataFrame(
        {"time_s": np.arange(rows) / 1000}
        | {name: rng.normal(size=rows) * 0.3 for name in AXES}
        | {"temperature_degc": 20 + np.arange(rows) / rows}
    )
    frame.write_parquet(folder / "log.parquet", row_group_size=1 << 20)
    frame[: rows // 10].write_csv(folder / "log.csv")
    plain = Calibration(MATRIX, BIAS, np.zeros((12, 12)))
    write_calibration(folder / "linear.json", plain)
    write_calibration(folder / "terms.json", Calibration(MATRIX, BIAS, np.zeros((12, 12)), extra={"terms": TERMS}))


def step(name: str, folder: Path) -> None:
    """One way from file to file."""
    from tumblecal.cli.apply import apply
    from tumblecal.data.calibration import read_calibration
    from tumblecal.data.raw import opened_raw
    from tumblecal.data.reading_checks import ReadingChecks

    log, out = folder / "log.parquet", folder / f"{name}.parquet"
    if name in ("read", "correct"):
        header, frames = opened_raw(log)
        checks, calibration = ReadingChecks(header.columns, "row"), read_calibration(folder / "linear.json")
        for frame in frames():
            if name == "correct":
                piece = header.with_rows(frame)
                checks.add(piece.readings, 1)
                calibration.corrected(piece.readings)
        return
    if name.startswith("copy"):
        pl.scan_parquet(log).sink_parquet(out, compression=name.partition(", ")[2] or "lz4")  # type: ignore[arg-type]
        return
    if name == "numpy":
        frame = pl.read_parquet(log)
        force = (np.column_stack([frame[axis].to_numpy() for axis in AXES]) - BIAS) @ MATRIX.T
        frame.with_columns(pl.Series(axis, force[:, k]) for k, axis in enumerate(AXES)).write_parquet(
            out, compression="lz4"
        )
    elif name == "polars":
        pl.scan_parquet(log).with_columns(
            sum((row[k] * (pl.col(axis) - BIAS[k]) for k, axis in enumerate(AXES)), pl.lit(0.0)).alias(own)
            for row, own in zip(MATRIX, AXES, strict=True)
        ).sink_parquet(out, compression="lz4")
    elif name == "apply, text":
        apply(folder / "linear.json", folder / "log.csv", out=folder / "out.csv")
    else:
        apply(folder / f"{'terms' if 'terms' in name else 'linear'}.json", log, out=out)


def peak_mb() -> float:
    """Most memory that this process held; what `getrusage` says is also of the process that started it."""
    status = Path("/proc/self/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return float(next(line for line in status.read_text().splitlines() if line.startswith("VmHWM")).split()[1]) / 1024


def measured(name: str, folder: Path, rows: int) -> dict[str, float]:
    """Wall and processor time of a step without the start of Python, s, and its peak memory, MB."""
    command = [sys.executable, __file__, "--step", name, "--folder", str(folder), "--rows", str(rows)]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=20_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--step", help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.step:
        before, began = os.times(), time.monotonic()
        recording(asked.folder, asked.rows) if asked.step == "recording" else step(asked.step, asked.folder)
        after, wall = os.times(), time.monotonic() - began
        cpu = after.user + after.system - before.user - before.system
        size = sum(path.stat().st_size for path in asked.folder.glob(f"{asked.step}.parquet")) / 1e6
        print(json.dumps({"wall": wall, "cpu": cpu, "peak": peak_mb(), "size": size}))
        return
    with TemporaryDirectory() as name:
        folder = Path(name)
        measured("recording", folder, asked.rows)
        print(f"{'':24}{'rows/s':>12}{'rows/CPU-s':>12}{'peak MB':>10}{'file MB':>10}{'CPU of copy':>14}")
        runs = [{own: measured(own, folder, asked.rows) for own in STEPS} for _ in range(asked.repeats)]
        results = {
            own: {of: min(run[own][of] for run in runs) for of in ("wall", "cpu", "peak", "size")} for own in STEPS
        }
        for own, took in results.items():
            rows = asked.rows // 10 if own == "apply, text" else asked.rows
            ratio = took["cpu"] / rows / (results["copy"]["cpu"] / asked.rows)
            rates = f"{rows / took['wall']:12.3g}{rows / took['cpu']:12.3g}"
            print(f"{own:24}{rates}{took['peak']:10.0f}{took['size']:10.0f}{ratio:14.2f}")
        exact, ours = (pl.read_parquet(folder / f"{own}.parquet", columns=list(AXES)) for own in ("numpy", "apply"))
        print(f"largest difference to numpy: {float(np.abs(exact.to_numpy() - ours.to_numpy()).max()):.1e} g")


if __name__ == "__main__":
    main()
