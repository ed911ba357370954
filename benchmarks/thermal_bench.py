"""`tumblecal thermal` on a simulator that is not the chain.

    python benchmarks/thermal_bench.py --units 16 --seed 4113

Printed: use, U of corrected readings, orders. Units have a bias of order 1 to 3, a scale factor of order 0 to 2 and a
non-orthogonality of 3 mrad, constant or linear; half of them have hysteresis of 0.05 to 0.6 mg, and 30 % of those on ramps a
lag of the thermometer or an effect of the rate. A sixth has an effect that the model lacks: a quadratic term, a face that
moved, or a drift. Each calibration is applied to readings without noise at 40 new attitudes, temperatures and states of the
hysteresis. `adequate`: no effect that the model lacks (in files of one face at one soak, no hysteresis either), and enough
soaks: they determine the orders, and the sizes of gravity outnumber the parameters. `u(T)`: 95 % intervals of the changes of
bias and scale factor that contain the mean of both branches. `order too high`: of units without hysteresis, lag or effect of
the rate.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from command_line import asked, counted, print_head, print_row
from thermal_instrument import Programme, Unit, attitudes, instrument, means, readings, soak_means, truth
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_use import Use
from tumblecal.data.position_comments import ATTITUDES, UNKNOWN
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters
from tumblecal.ground.precision import enable_float64, single_blas_thread
from tumblecal.recordings.thermal.thermal_table import INDEPENDENT, READINGS, SDS, ThermalTable
from tumblecal.thermal.result import ThermalResult, thermal_calibration
from tumblecal.thermal.stated import Stated


NEW, BASE_SD = 40, np.full(9, 1e-4)
FACES = {6: np.concatenate([np.eye(3), -np.eye(3)])}
EDGES = np.array([(1, 1, 0), (1, -1, 0), (0, 1, 1), (0, 1, -1), (1, 0, 1), (-1, 0, 1)]) / np.sqrt(2)
FACES[12] = np.concatenate([FACES[6], EDGES])
# Kind, number of attitudes, soaks. `files`: faces by hand, each soak in a file; `steps`: soaks up and down.
PLANS = {
    "6 attitudes, 2 soaks in files of their own": ("files", 6, 2),
    "6 attitudes, 3 soaks in files of their own": ("files", 6, 3),
    "12 attitudes, 2 soaks in files of their own": ("files", 12, 2),
    "12 attitudes, 3 soaks in files of their own": ("files", 12, 3),
    "6 attitudes, ramp up": ("ramp up", 6, 0),
    "6 attitudes, ramp up and down": ("ramp up and down", 6, 0),
    "6 attitudes, ramps at two rates": ("ramps at two rates", 6, 0),
    "24 attitudes, ramp up and down": ("ramp up and down", 24, 0),
    "24 attitudes, 3 to 7 soaks up and down": ("steps", 24, 0),
    "1 attitude, ramp up and down": ("ramp up and down", 1, 0),
}
HEADS = ("plan", "instruments", "`use`", "adequate: `yes` or `within`", "error at most U", "worst instrument")
HEADS = (*HEADS, "median U / mg", "error / mg", "raw / mg", "u(T)", "order too high")


@dataclass(frozen=True)
class Outcome:
    """One unit: `use`, whether it is adequate, share of the errors within U, rms errors and U (mg), whether an order is too
    high (None: there are effects of the history), share of the intervals of u(T) with the true value."""

    answer: str
    adequate: bool
    within: float
    error_mg: float
    raw_mg: float
    expanded_mg: float
    too_high: bool | None
    covered: float


def drawn(rng: np.random.Generator, kind: str, soaks: int, lacking: bool) -> tuple[Unit, dict, str]:
    """A unit, options of its readings, and the effect that the model lacks."""
    highest = min(3, soaks) if kind == "files" else 3
    orders = {"bias_order": int(rng.integers(1, highest + 1)), "scale_order": int(rng.integers(0, 3))}
    hysteresis = float(rng.choice([0.0, rng.uniform(0.05, 0.6)]))
    orders["cross_order"] = int(rng.integers(0, 2))
    unit = instrument(rng, **orders, bias_mg=float(np.exp(rng.uniform(0, 2.5))), hysteresis_mg=hysteresis)
    constants = unit.constants.copy()
    constants[6:] = 3e-3 * rng.normal(size=3)
    unit, options = replace(unit, constants=constants), {"width": float(rng.choice([0.0, 20.0]))}
    if kind != "files" and rng.random() < 0.3:
        options |= rng.choice([{"lag_s": rng.uniform(5, 40)}, {"rate_effect": rng.uniform(0.002, 0.02)}])
    # Files of one face each at one soak show neither a move nor a drift.
    lacks = str(rng.choice(["quadratic"] if kind == "files" else ["quadratic", "moved", "drift"])) if lacking else ""
    if lacks == "quadratic":
        unit = replace(unit, square=1e-3 * np.exp(rng.uniform(np.log(0.05), np.log(2))) * rng.choice([-1, 1], 3))
    if lacks == "drift":
        options["drift_mg_per_h"] = rng.uniform(0.5, 2)
    return unit, options, lacks


def measured(
    rng: np.random.Generator, kind: str, count: int, soaks: int, unit: Unit, options: dict, lacks: str
) -> dict:
    """The columns of the table of a plan."""
    if kind == "files":
        return soak_means(rng, unit, FACES[count], np.linspace(unit.low + 5, unit.high - 5, soaks), 0.1)
    rate, forces = float(np.exp(rng.uniform(np.log(0.3), np.log(4.0)))), attitudes(rng, count)
    legs = [(unit.high, rate)] if kind == "ramp up" else [(unit.high, rate), (unit.low, rate)]
    if kind == "ramps at two rates":
        legs += [(unit.high, 3 * rate), (unit.low, 3 * rate)]
    programme = Programme(unit.low, tuple(legs))
    if kind == "steps":
        levels = np.linspace(unit.low, unit.high, int(rng.integers(3, 8)))
        programme = Programme(unit.low, tuple((float(t), rate) for t in [*levels[1:], *levels[-2::-1]]), soak_min=20.0)
    columns = means(rng, unit, forces, programme, 0.03, bins=40 if count < 9 else 20, **options)
    if lacks == "moved":
        moved = np.asarray(columns["temperature_degc"]) > (unit.low + unit.high) / 2
        columns["readings"][moved & (np.array(columns["attitude"]) == "a0")] += 5e-3 * rng.normal(size=3)
    return columns


def table_of(attitude: Sequence[str], readings: ArrayLike, sd: ArrayLike, temperature_degc: ArrayLike, **columns):
    """A table; single numbers are valid for all rows. By default: one row a minute, all on one rising branch and clock."""
    count, columns = len(attitude), {"n": 1000.0, "direction": 0, "rate_degc_per_s": 0.0, **columns}
    given = {"branch": "arrays:1 up", "clock": "1", "time_s": 60.0 * np.arange(count), "n_eff": columns["n"]}
    given |= {"reached_by": columns["direction"], **columns, "sd": sd, "temperature_degc": temperature_degc}
    frame = pl.DataFrame({"position": attitude}).with_columns(pl.from_numpy(np.asarray(readings, float), READINGS))
    for name, values in given.items():
        names = {"sd": SDS, "n_eff": INDEPENDENT, "clock": ["run"]}.get(name, [name])
        column = np.reshape(values, (-1, 1)) if np.shape(values) == (count,) else values
        array = np.broadcast_to(column, (count, len(names)))
        frame = frame.with_columns(pl.Series(each, array[:, k]) for k, each in enumerate(names))
    return ThermalTable(frame.cast({"direction": int, "reached_by": int}), "arrays", {ATTITUDES: UNKNOWN})


def outcome(rng: np.random.Generator, plan: tuple[str, int, int], lacking: bool) -> Outcome:
    """Calibrate one unit, and judge corrected readings."""
    kind, count, soaks = plan
    unit, options, lacks = drawn(rng, kind, soaks, lacking)
    table, stated = table_of(**measured(rng, kind, count, soaks, unit, options, lacks)), Stated()
    if count == 1:
        known = truth(unit, [25.0])[0] + BASE_SD * rng.normal(size=9)
        sensor, use = SensorParameters(SENSOR, known, np.diag(BASE_SD**2)), Use("yes", expanded_g=4e-4)
        stated = Stated(base=Calibration(np.eye(3), np.zeros(3), np.zeros((12, 12)), parameters=sensor, use=use))
    result = thermal_calibration(table, stated)
    use = result.calibration.use
    low, high = np.clip(use.temperature_degc or table.range_degc, unit.low, unit.high)
    force, degc = rng.normal(size=(NEW, 3)), rng.uniform(low, high, NEW)
    force /= np.linalg.norm(force, axis=1)[:, None]
    raw = readings(unit, force, degc, rng.choice([-1.0, 1.0], NEW))
    error = result.calibration.corrected(raw, degc, extrapolate=True) - force
    expanded, hysteresis, orders = use.expanded_g or np.nan, bool(np.any(unit.hysteresis)), true_orders(unit)
    adequate = not lacks
    if kind == "files":
        changes = [max(orders[leaf], 1) for leaf in ("bias", "dK")]
        adequate = not (lacks or hysteresis) and max(changes) < soaks and 9 + 3 * sum(changes) < count * soaks
    with_history = hysteresis or bool({"lag_s", "rate_effect"} & {*options})
    return Outcome(
        use.answer or "",
        adequate,
        float(np.mean(np.abs(error) <= expanded)),
        *(1e3 * float(np.sqrt(np.mean(own**2))) for own in (error, raw - force)),
        1e3 * expanded,
        None if with_history else any(result.choice.orders.get(leaf, 0) > order for leaf, order in orders.items()),
        covered(result, unit, np.linspace(low, high, 9)) if adequate and count > 1 else np.nan,
    )


def true_orders(unit: Unit) -> dict[str, int]:
    """The order of the dependence on temperature of each leaf."""
    rows = {"dK": unit.changes[:3], "bias": unit.changes[3:6], "gamma": unit.changes[6:]}
    return {leaf: int(np.max(np.flatnonzero(np.any(part, axis=0)), initial=-1)) + 1 for leaf, part in rows.items()}


def covered(result: ThermalResult, unit: Unit, degc: np.ndarray) -> float:
    """The share of the 95 % intervals of changes of bias and scale factor with the true value; NaN without a curve."""
    curves = result.curves
    if curves is None:
        return np.nan
    error = curves.at(degc) - (truth(unit, degc) - truth(unit, [curves.reference_degc])[0])
    covariance = curves.covariance.copy()
    covariance[:9], covariance[:, :9] = 0.0, 0.0
    sd = replace(curves, covariance=covariance).sd(degc)
    return float(np.mean((np.abs(error) < 1.96 * sd)[(sd > 0) & (np.arange(9) < 6)]))


def row(words: str, found: Sequence[Outcome]) -> None:
    """A row of the population."""
    usable, adequate = [own for own in found if own.answer in ("yes", "within")], [own for own in found if own.adequate]
    intervals = [own.covered for own in found if np.isfinite(own.covered)]
    plain = [own.too_high for own in found if own.too_high is not None]
    within = [own.within for own in usable]
    cells = [words, str(len(found)), counted(own.answer for own in found)]
    cells.append(f"{sum(own in usable for own in adequate)} of {len(adequate)}")
    cells += [f"{np.mean(within):.1%}", f"{min(within):.0%}"] if usable else ["-", "-"]
    cells.append(f"{np.median([own.expanded_mg for own in usable]):.2g}" if usable else "-")
    cells += [f"{np.sqrt(np.mean([getattr(own, name) ** 2 for own in found])):.2g}" for name in ("error_mg", "raw_mg")]
    cells += [f"{np.mean(intervals):.1%}" if intervals else "-", f"{sum(plain)} of {len(plain)}"]
    print_row(*cells)


def population(units: int, seed: int) -> None:
    """A row for each plan, and the sums."""
    print_head(*HEADS)
    everything = []
    for number, (words, plan) in enumerate(PLANS.items()):
        found = []
        for unit in range(units):
            with single_blas_thread():
                found.append(outcome(np.random.default_rng([seed, number, unit]), plan, lacking=unit % 6 == 5))
        row(words, found)
        everything += found
    row("all", everything)


def main() -> None:
    """Calibrate the population."""
    given = asked(__doc__, units=16, seed=4113)
    enable_float64()
    population(given.units, given.seed)


if __name__ == "__main__":
    main()
