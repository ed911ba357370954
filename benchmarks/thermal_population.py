"""`tumblecal thermal` on many units of a simulator that is not the chain: `use`, U of corrected readings, orders.

    python benchmarks/thermal_population.py --units 16 --seed 4113

Each unit has a bias of order 1 to 3 and a scale factor of order 0 to 2, at most one above those that its plan determines; a
non-orthogonality of 3 mrad, constant or linear; half of the units have hysteresis of 0.05 to 0.6 mg (play, or a loop closed at
the ends), and 30 % of those on ramps a lag of the thermometer or an effect of the rate. A sixth of the units also have an
effect that the model lacks: a quadratic term, a face that moved, or a drift. Plans: faces set by hand at soaks in files of
their own (noise of a mean 0.1 mg), ramps and soaks of 1, 6 or 24 unknown attitudes (0.03 mg). Each calibration is applied to
readings without noise at 40 new attitudes, temperatures of its range and states of the hysteresis, at rest.

`adequate`: units without an effect that the model lacks (in files of one face at one soak, hysteresis too), measured at enough
soaks: they determine the orders, and the sizes of gravity outnumber the nine parameters and the changes of bias and scale
factor (at least linear). `u(T)`: 95 % intervals of these changes, of adequate units, that contain the mean of both branches.
`order too high`: of units without hysteresis, lag or effect of the rate.
"""

import argparse
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from thermal_instrument import Programme, Unit, attitudes, instrument, means, readings, soak_means, truth
from tumblecal.capture.thermal.thermal_table import table_of
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_use import Use
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters
from tumblecal.ground.blas import single_blas_thread
from tumblecal.ground.precision import enable_float64
from tumblecal.thermal.choice import Stated
from tumblecal.thermal.result import ThermalResult, thermal_calibration


NEW = 40
BASE_SD = np.array([1e-4] * 3 + [1e-4] * 3 + [1e-4] * 3)
FACES = {6: np.concatenate([np.eye(3), -np.eye(3)])}
FACES[12] = np.concatenate(
    [FACES[6], np.array([(1, 1, 0), (1, -1, 0), (0, 1, 1), (0, 1, -1), (1, 0, 1), (-1, 0, 1)]) / np.sqrt(2)]
)


@dataclass(frozen=True)
class Plan:
    """Faces by hand at soaks (`soaks` in files of their own), or `count` attitudes on a programme: `ramp` (up, up and down, two
    rates) or `steps` (soaks up and down)."""

    kind: str
    count: int
    soaks: int = 0

    @property
    def words(self) -> str:
        """The plan in a cell of a table."""
        kinds = {"files": f"{self.soaks} soaks in files of their own", "steps": "3 to 7 soaks up and down"}
        return f"{self.count} attitudes, {kinds.get(self.kind, self.kind)}"


PLANS = (
    Plan("files", 6, 2),
    Plan("files", 6, 3),
    Plan("files", 12, 2),
    Plan("files", 12, 3),
    Plan("ramp up", 6),
    Plan("ramp up and down", 6),
    Plan("ramps at two rates", 6),
    Plan("ramp up and down", 24),
    Plan("steps", 24),
    Plan("ramp up and down", 1),
)


@dataclass(frozen=True)
class Outcome:
    """One unit: `use`; errors of new readings, their share within U, raw errors (mg); U (mg); whether it is adequate; whether
    an order is too high (None: there are effects of the history); share of the intervals of u(T) with the truth."""

    answer: str
    adequate: bool
    within: float
    error_mg: float
    raw_mg: float
    expanded_mg: float
    too_high: bool | None
    covered: float


def drawn(rng: np.random.Generator, plan: Plan, lacking: bool) -> tuple[Unit, dict, str]:
    """A unit, options of its readings, and the effect that the model lacks."""
    highest = min(3, plan.soaks) if plan.kind == "files" else 3
    orders = {"bias_order": int(rng.integers(1, highest + 1)), "scale_order": int(rng.integers(0, 3))}
    hysteresis = float(rng.choice([0.0, rng.uniform(0.05, 0.6)]))
    unit = instrument(
        rng,
        **orders,
        cross_order=int(rng.integers(0, 2)),
        bias_mg=float(np.exp(rng.uniform(0, 2.5))),
        hysteresis_mg=hysteresis,
    )
    constants = unit.constants.copy()
    constants[6:] = 3e-3 * rng.normal(size=3)
    unit, options = replace(unit, constants=constants), {"width": float(rng.choice([0.0, 20.0]))}
    if plan.kind != "files" and rng.random() < 0.3:
        options |= rng.choice([{"lag_s": rng.uniform(5, 40)}, {"rate_effect": rng.uniform(0.002, 0.02)}])
    # Files of one face each at one soak show neither a move nor a drift.
    kinds = ["quadratic"] if plan.kind == "files" else ["quadratic", "moved", "drift"]
    lacks = str(rng.choice(kinds)) if lacking else ""
    if lacks == "quadratic":
        unit = replace(unit, square=1e-3 * np.exp(rng.uniform(np.log(0.05), np.log(2))) * rng.choice([-1, 1], 3))
    if lacks == "drift":
        options["drift_mg_per_h"] = rng.uniform(0.5, 2)
    return unit, options, lacks


def measured(rng: np.random.Generator, plan: Plan, unit: Unit, options: dict, lacks: str) -> dict:
    """The columns of the table of a plan."""
    if plan.kind == "files":
        return soak_means(rng, unit, FACES[plan.count], np.linspace(unit.low + 5, unit.high - 5, plan.soaks), 0.1)
    rate, forces = float(np.exp(rng.uniform(np.log(0.3), np.log(4.0)))), attitudes(rng, plan.count)
    legs = [(unit.high, rate), (unit.low, rate)]
    if plan.kind == "ramp up":
        legs = legs[:1]
    if plan.kind == "ramps at two rates":
        legs += [(unit.high, 3 * rate), (unit.low, 3 * rate)]
    programme = Programme(unit.low, tuple(legs))
    if plan.kind == "steps":
        levels = np.linspace(unit.low, unit.high, int(rng.integers(3, 8)))
        programme = Programme(unit.low, tuple((float(t), rate) for t in [*levels[1:], *levels[-2::-1]]), soak_min=20.0)
    columns = means(rng, unit, forces, programme, 0.03, bins=40 if plan.count < 9 else 20, **options)
    if lacks == "moved":
        turn = np.array(columns["attitude"]) == "a0"
        turn &= np.asarray(columns["temperature_degc"]) > (unit.low + unit.high) / 2
        columns["readings"][turn] += 5e-3 * rng.normal(size=3)
    return columns


def outcome(rng: np.random.Generator, plan: Plan, lacking: bool) -> Outcome:
    """Calibrate one unit, and judge corrected readings."""
    unit, options, lacks = drawn(rng, plan, lacking)
    table, stated = table_of(**measured(rng, plan, unit, options, lacks)), Stated()
    if plan.count == 1:
        known = truth(unit, [25.0])[0] + BASE_SD * rng.normal(size=9)
        sensor = SensorParameters(SENSOR, known, np.diag(BASE_SD**2))
        base = Calibration(
            np.eye(3), np.zeros(3), np.zeros((12, 12)), parameters=sensor, use=Use("yes", expanded_g=4e-4)
        )
        stated = Stated(base=base)
    result = thermal_calibration(table, stated)
    calibration, use = result.calibration, result.calibration.use
    low, high = np.clip(use.temperature_degc or table.range_degc, unit.low, unit.high)
    force, degc = rng.normal(size=(NEW, 3)), rng.uniform(low, high, NEW)
    force /= np.linalg.norm(force, axis=1)[:, None]
    raw = readings(unit, force, degc, rng.choice([-1.0, 1.0], NEW))
    error = calibration.corrected(raw, degc, extrapolate=True) - force
    expanded, history = use.expanded_g or np.nan, bool(np.any(unit.hysteresis))
    adequate = not lacks and enough_soaks(plan, unit) and not (history and plan.kind == "files")
    history |= bool({"lag_s", "rate_effect"} & {*options})
    return Outcome(
        use.answer or "",
        adequate,
        float(np.mean(np.abs(error) <= expanded)),
        1e3 * float(np.sqrt(np.mean(error**2))),
        1e3 * float(np.sqrt(np.mean((raw - force) ** 2))),
        1e3 * expanded,
        None if history else too_high(result, unit),
        covered(result, unit, np.linspace(low, high, 9)) if adequate and plan.count > 1 else np.nan,
    )


def true_orders(unit: Unit) -> dict[str, int]:
    """The order of the dependence on temperature of each leaf."""
    rows = {"dK": unit.changes[:3], "bias": unit.changes[3:6], "gamma": unit.changes[6:]}
    return {leaf: int(np.max(np.flatnonzero(np.any(part, axis=0)), initial=-1)) + 1 for leaf, part in rows.items()}


def enough_soaks(plan: Plan, unit: Unit) -> bool:
    """Whether the soaks determine the orders, and the sizes of gravity outnumber parameters and changes."""
    if plan.kind != "files":
        return True
    orders = [max(true_orders(unit)[leaf], 1) for leaf in ("bias", "dK")]
    return max(orders) < plan.soaks and 9 + 3 * sum(orders) < plan.count * plan.soaks


def too_high(result: ThermalResult, unit: Unit) -> bool:
    """Whether any order is above the true one."""
    return any(result.choice.orders.get(leaf, 0) > order for leaf, order in true_orders(unit).items())


def covered(result: ThermalResult, unit: Unit, degc: np.ndarray) -> float:
    """The share of the 95 % intervals of changes of bias and scale factor that contain the truth; NaN without a curve."""
    curves = result.curves
    if curves is None:
        return np.nan
    error = curves.at(degc) - (truth(unit, degc) - truth(unit, [curves.reference_degc])[0])
    covariance = curves.covariance.copy()
    covariance[:9], covariance[:, :9] = 0.0, 0.0
    sd = replace(curves, covariance=covariance).sd(degc)
    estimated = (sd > 0) & np.isin([*range(9)], range(6))
    return float(np.mean((np.abs(error) < 1.96 * sd)[estimated]))


def main() -> None:
    """Print a table with a row for each plan, and the sums."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--units", type=int, default=16, help="of each plan")
    parser.add_argument("--seed", type=int, default=4113)
    parser.add_argument("--plans", type=int, nargs="*", default=[*range(len(PLANS))])
    asked = parser.parse_args()
    enable_float64()
    columns = (
        "plan",
        "units",
        "use",
        "adequate: yes or within",
        "error at most U",
        "worst unit",
        "median U / mg",
        "error / mg",
        "raw / mg",
        "u(T)",
        "order too high",
    )
    print("| " + " | ".join(columns) + " |\n|" + "---|" * len(columns))
    everything = list[Outcome]()
    for number in asked.plans:
        found = list[Outcome]()
        for unit in range(asked.units):
            rng = np.random.default_rng([asked.seed, number, unit])
            with single_blas_thread():
                found.append(outcome(rng, PLANS[number], lacking=unit % 6 == 5))
        row(PLANS[number].words, found)
        everything += found
    row("together", everything)


def row(words: str, found: list[Outcome]) -> None:
    """Print one row."""
    usable = [each for each in found if each.answer in ("yes", "within")]
    adequate = [each for each in found if each.adequate]
    intervals = [each.covered for each in found if np.isfinite(each.covered)]
    plain = [each.too_high for each in found if each.too_high is not None]
    answers = ", ".join(f"{count} {answer}" for answer, count in sorted(Counter(each.answer for each in found).items()))
    sizes = [np.sqrt(np.mean([getattr(each, name) ** 2 for each in found])) for name in ("error_mg", "raw_mg")]
    cells = [
        words,
        str(len(found)),
        answers,
        f"{sum(each in usable for each in adequate)} of {len(adequate)}",
        f"{100 * np.mean([each.within for each in usable]):.1f} %" if usable else "-",
        f"{100 * min(each.within for each in usable):.0f} %" if usable else "-",
        f"{np.median([each.expanded_mg for each in usable]):.2g}" if usable else "-",
        *(f"{size:.2g}" for size in sizes),
        f"{100 * np.mean(intervals):.1f} %" if intervals else "-",
        f"{sum(plain)} of {len(plain)}",
    ]
    print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
