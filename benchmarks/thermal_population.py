"""`tumblecal thermal` on many units of a simulator that is not the chain: orders, errors on a fresh branch, coverage of u(T).

    python benchmarks/thermal_population.py --units 20 --seed 1

Each unit has a bias of order 1 to 5, a scale factor of order 0 to 2, a constant or linear non-orthogonality, with or without
hysteresis; ramps of 0.2 to 5 K/min up and down, or 3 to 8 soaks; 6 or 24 unknown attitudes. The calibration is applied to
readings of a fresh falling branch without hysteresis, with fresh noise. With 6 attitudes the non-orthogonality at the reference
is not determined, so the constant error of each attitude is removed there, and the coverage is that of the changes.
"""

import argparse
from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np

from thermal_instrument import Programme, attitudes, instrument, means, truth
from tumblecal.capture.thermal.thermal_table import table_of
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.ground.precision import enable_float64
from tumblecal.thermal.result import thermal_calibration


NOISE_MG = 0.03


@dataclass(frozen=True)
class Outcome:
    """One unit: orders, ratio of the error on a fresh branch to noise, half width of the hysteresis (mg), coverage."""

    too_high: bool
    too_low: bool
    after_mg: float
    hysteresis_mg: float
    covered: np.ndarray


def outcome(
    rng, count: int, orders: tuple[int, int, int], hysteresis_mg: float, soaks: int, rate: float, width: float
) -> Outcome:
    """Calibrate one unit and score it."""
    bias, scale, cross = orders
    unit = instrument(rng, bias_order=bias, scale_order=scale, cross_order=cross, hysteresis_mg=hysteresis_mg)
    forces = attitudes(rng, count)
    if soaks:
        degc = np.linspace(unit.low, unit.high, soaks)
        legs = tuple((float(value), rate) for value in [*degc[1:], *degc[-2::-1]])
        programme = Programme(unit.low, legs, soak_min=20.0)
    else:
        programme = Programme(unit.low, ((unit.high, rate), (unit.low, rate)))
    table = table_of(**means(rng, unit, forces, programme, NOISE_MG, width=width))
    result = thermal_calibration(table)
    fresh = replace(unit, hysteresis=np.zeros(3))
    falling = Programme(unit.high, ((unit.low + 1.0, rate),))
    held = means(rng, fresh, forces, falling, NOISE_MG)
    degc = held["temperature_degc"]
    low, high = table.range_degc
    inside = (degc >= low) & (degc <= high)
    force = result.calibration.corrected(held["readings"][inside], degc[inside])
    attitude = np.array(held["attitude"])[inside]
    error = force - np.array([forces[int(name[1:])] for name in attitude])
    if count < 9:
        for name in dict.fromkeys(attitude.tolist()):
            error[attitude == name] -= error[attitude == name].mean(0)
    covered = coverage(result, unit, np.linspace(low, high, 9), whole=count >= 9)
    found = [result.choice.orders.get(leaf, 0) for leaf in ("bias", "dK", "gamma")]
    able = [result.choice.highest.get(leaf, 0) for leaf in ("bias", "dK", "gamma")]
    return Outcome(
        any(a > b for a, b in zip(found, orders, strict=True)),
        any(a < min(b, c) for a, b, c in zip(found, orders, able, strict=True)),
        1e3 * float(np.sqrt(np.mean(error**2))),
        1e3 * float(np.sqrt(np.mean(unit.hysteresis**2))),
        covered,
    )


def coverage(result, unit, grid, *, whole: bool) -> np.ndarray:
    """Whether the 95 % intervals of biases and scale factors contain the truth at temperatures; only of their changes, if the
    attitudes do not determine all values at the reference."""
    curves = result.curves
    if curves is None:
        return np.zeros((0, 6), bool)
    at_reference = truth(unit, [curves.reference_degc])[0]
    error = curves.at(grid) - (truth(unit, grid) - at_reference)
    if whole:
        error = error + result.calibration.sensor.of(SENSOR).values - at_reference
    else:
        covariance = curves.covariance.copy()
        covariance[:9], covariance[:, :9] = 0.0, 0.0
        curves = replace(curves, covariance=covariance)
    sd = curves.sd(grid)
    return (np.abs(error) < 1.96 * sd)[:, :6][(sd > 0)[:, :6]]


def main() -> None:
    """Print a table with a row for each condition."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--units", type=int, default=20, help="of each condition")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--attitudes", type=int, nargs="*", default=[6, 24])
    asked = parser.parse_args()
    enable_float64()
    columns = ("attitudes", "programme", "hysteresis", "units", "order too high", "too low", "error / noise", "covered")
    print("| " + " | ".join(columns) + " |\n|" + "---|" * len(columns))
    totals: dict[str, list[Outcome]] = defaultdict(list)
    kinds = ((0.0, 0.0, "none"), (0.3, 0.0, "0.3 mg, ellipse"), (0.3, 20.0, "0.3 mg, play"))
    for count in asked.attitudes:
        for soaks in (0, 1):
            for hysteresis, width, kind in kinds:
                found = []
                for number in range(asked.units):
                    rng = np.random.default_rng([asked.seed, count, soaks, int(10 * hysteresis + width), number])
                    steps = int(rng.integers(3, 9)) if soaks else 0
                    highest = min(5, steps - 1) if steps else 5
                    orders = int(rng.integers(1, highest + 1)), int(rng.integers(0, 3)), int(rng.integers(0, 2))
                    rate = float(np.exp(rng.uniform(np.log(0.2), np.log(5.0))))
                    found.append(outcome(rng, count, orders, hysteresis, steps, rate, width))
                ratio = np.sqrt(np.mean([each.after_mg**2 for each in found])) / NOISE_MG
                words = "soaks" if soaks else "ramps"
                covered = np.mean(np.concatenate([each.covered.ravel() for each in found]))
                cells = [
                    str(count), words, kind, str(len(found)),
                    f"{np.mean([each.too_high for each in found]):.1%}", f"{np.mean([each.too_low for each in found]):.1%}",
                    f"{ratio:.3f}", f"{covered:.1%}",
                ]  # fmt: skip
                print("| " + " | ".join(cells) + " |", flush=True)
                totals[kind] += found
    for words, found in totals.items():
        print(f"hysteresis {words}: order too high in {np.mean([each.too_high for each in found]):.1%} of {len(found)}")


if __name__ == "__main__":
    main()
