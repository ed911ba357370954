"""Methods for the bias over temperature side by side, on recordings of one attitude that are as unequal in time as real ones.

    python benchmarks/thermal_methods.py --units 10 --seed 1

A unit rests in one attitude while it warms from cold, stays hot for an hour, and cools. The methods of PX4
(process_sensor_caldata.py) and ArduPilot (tempcal_IMU.py) are re-derived from their formulas: third-order polynomials by least
squares over all samples, about the middle of the range and about 35 degC. `tumblecal thermal` averages in temperature bins and
chooses the order. Each method uses the warming branch and the hot hour only. Its error is the root mean square of the change of
the readings with the temperature that it leaves on the cooling branch, over equal steps of temperature.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from thermal_instrument import Programme, attitudes, history, instrument, readings, recording, write_recording
from tumblecal.data.calibration import read_calibration


RATE_HZ = 2.0
ARDUPILOT_REFERENCE_DEGC = 35.0


def polynomial(degc, values, about):
    """Coefficients of the third order for each axis, by all samples."""
    return [np.polyfit(degc - about, values[:, axis], 3) for axis in range(3)]


def left_mg(unit, force, corrected):
    """What a correction leaves of the change with temperature on the cooling branch, mg."""
    grid = np.linspace(unit.high - 1, unit.low + 1, 60)
    rest = corrected(readings(unit, np.repeat(force[None], len(grid), 0), grid), grid)
    return 1e3 * float(np.sqrt(np.mean((rest - rest.mean(0)) ** 2)))


def errors(rng, order, folder):
    """Errors of no correction and of the three methods for one unit, mg; the orders that tumblecal chose."""
    unit = instrument(rng, bias_order=order, scale_order=0)
    force = attitudes(rng, 1)[0]
    programme = Programme(unit.low, ((unit.high, 1.0),), soak_min=60.0)
    times, values, degc = recording(rng, unit, force, programme, rate_hz=RATE_HZ)
    # The hour at the start of `history` is not recorded: the unit is switched on cold.
    begun = int(np.argmax(np.abs(history(programme, 1 / RATE_HZ)[2]) > 0))
    times, values, degc = times[begun:], values[begun:], degc[begun:]
    middle = (degc.min() + degc.max()) / 2
    px4, ardupilot = polynomial(degc, values, middle), polynomial(degc, values, ARDUPILOT_REFERENCE_DEGC)
    file = Path(folder, "still.csv")
    write_recording(file, times, values, degc)
    command = [sys.executable, "-m", "tumblecal", "thermal", str(file), "--out", str(Path(folder, "out")), "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 3):
        raise RuntimeError(done.stderr)
    calibration = read_calibration(Path(folder, "out", "calibration.json"))
    chosen = json.loads(Path(folder, "out", "thermal.json").read_text())["orders"]["bias"]

    def by(coefficients, about):
        return lambda rows, t: rows - np.column_stack([np.polyval(each, t - about) for each in coefficients])

    found = [
        left_mg(unit, force, lambda rows, t: rows),
        left_mg(unit, force, by(px4, middle)),
        left_mg(unit, force, by(ardupilot, ARDUPILOT_REFERENCE_DEGC)),
        left_mg(unit, force, lambda rows, t: calibration.corrected(rows, t, extrapolate=True)),
    ]
    return found, chosen


def main():
    """Print a row for each order of the bias."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--units", type=int, default=10, help="of each order")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    print(
        "| order of the bias | units | not corrected / mg | PX4 / mg | ArduPilot / mg | tumblecal / mg | orders chosen |"
    )
    print("|---|---|---|---|---|---|---|")
    for order in range(1, 6):
        with TemporaryDirectory() as folder:
            made = [errors(np.random.default_rng([asked.seed, order, k]), order, folder) for k in range(asked.units)]
        sizes = np.sqrt(np.mean([np.square(found) for found, _ in made], axis=0))
        chosen = ", ".join(str(order) for order in sorted({chosen for _, chosen in made}))
        print(
            f"| {order} | {asked.units} | " + " | ".join(f"{size:.4f}" for size in sizes) + f" | {chosen} |", flush=True
        )


if __name__ == "__main__":
    main()
