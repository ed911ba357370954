"""A unit over time: changes of its parameters, repeatability, drift, and the recalibration interval."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import brentq
from scipy.special import ndtr, stdtr

from tumblecal.data.coverage_factor import coverage_factors
from tumblecal.data.sensor_parameters import GROUPS, leaf_of
from tumblecal.ground.option_texts import sizes
from tumblecal.ground.precision import single_blas_thread
from tumblecal.history.changes import Change, over_time
from tumblecal.history.entry import Entry


# Limits of the paper for differences between repeats (section 4), base units: 5e-4, 1.5 mg, 2 mrad, 5 mrad.
PAPER_LIMITS = {"dK": 5e-4, "bias": 1.5e-3, "gamma": 2e-3, "dtheta": 5e-3}
COVERAGE = 2.0  # k of the expanded uncertainties in E_n and on the charts, for known noise
# Probability that a unit without a change has none stated, for all parameters together.
TOGETHER = 0.95
# Fewer results cannot show a change: it equals their dispersion.
FEWEST = 4
# The mounting of the triad: its changes are not those of the unit.
MOUNTING = "dtheta"
DAYS_A_MONTH = 365.25 / 12
# Three standard deviations from the mean moving range (individuals charts, ISO 7870-2).
_MOVING_RANGE = 3 / 1.128


def limits_of(texts: Sequence[str]) -> dict[str, float]:
    """The limits of the paper, and in their place those of texts such as `bias=1 mg`, in base units.

    **Raises:** `InputError` for texts that are not limits.
    """
    units = {leaf: unit for leaf, (_, unit) in GROUPS.items()}
    return {**PAPER_LIMITS, **sizes("--limit ", texts, units, "'bias=1 mg'")}


@dataclass(frozen=True)
class Trend:
    """One parameter over time, base units.

    - `limit`: of the difference of two entries. `dof`: degrees of freedom of `scatter`, the standard deviation of a result.
    - `values`, `sd`: of each entry (sd 0: not stated). `expanded`: their uncertainty at 95.45 %, with Student's k for
      estimated noise. `fitted`: by the constant and the `changes`. `p_value`: of no change.
    - `en`: E_n of each entry and the previous one (ISO 13528), with the standard deviation between dates; nan without sd.
    - `drift`, `drift_sd`: per month, given the other changes, nan with less than three dates.
    """

    name: str
    unit: str
    limit: float
    dof: int
    values: Float[np.ndarray, " entries"]
    sd: Float[np.ndarray, " entries"]
    expanded: Float[np.ndarray, " entries"]
    fitted: Float[np.ndarray, " entries"]
    changes: list[Change]
    en: Float[np.ndarray, " steps"]
    p_value: float
    scatter: float
    drift: float
    drift_sd: float

    @property
    def mean(self) -> float:
        """Mean of the entries."""
        return float(np.mean(self.values))

    @property
    def control(self) -> float:
        """Half width of the control limits; nan for less than four entries."""
        return (
            _MOVING_RANGE * float(np.mean(np.abs(np.diff(self.values)))) if len(self.values) >= FEWEST else float("nan")
        )

    @property
    def outside(self) -> Bool[np.ndarray, " entries"]:
        """Entries beyond the control limits."""
        return np.abs(self.values - self.mean) > (self.control if self.control > 0 else np.inf)

    def months_until(self, risk: float, longest: float) -> float:
        """Months after which the parameter exceeds its limit with probability `risk`, at most `longest`.

        The change after t months has a Student distribution about drift t, with the sd of the drift and the dispersion about
        the line.
        """
        if not np.isfinite(self.drift):
            return float("nan")

        def beyond(months: float) -> float:
            sd = float(np.hypot(self.drift_sd * months, self.scatter)) or 1e-300
            ends = (-self.limit + np.array([-1.0, 1.0]) * self.drift * months) / sd
            return float(np.sum(stdtr(self.dof, ends)))

        if beyond(0.0) > risk or beyond(longest) <= risk:
            return 0.0 if beyond(0.0) > risk else longest
        return float(brentq(lambda months: beyond(months) - risk, 0.0, longest))  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True)
class Repeatability:
    """Repeatability of one kind of parameter, base units.

    - `sd`: standard deviation between dates without the changes, with `dof` degrees of freedom; nan for one entry.
    - `between`: the part of it that the median stated uncertainty `u` does not explain.
    - `largest`: the largest difference of two entries without the changes, `limit`: its limit.
    """

    leaf: str
    sd: float
    between: float
    u: float
    dof: int
    largest: float
    limit: float

    @property
    def beyond_limit(self) -> bool:
        """Whether two results of the unit differ by more than the limit."""
        return self.largest > self.limit and self.leaf != MOUNTING


@dataclass(frozen=True)
class UnitHistory:
    """Evaluation of a unit: the independent entries, trends by parameter, repeatability by kind."""

    entries: tuple[Entry, ...]
    trends: tuple[Trend, ...]
    repeats: tuple[Repeatability, ...]

    @property
    def months(self) -> float:
        """Time from the first to the last entry, months."""
        return months_of([entry.when for entry in self.entries])[-1] if self.entries else 0.0

    def interval(self, risk: float) -> tuple[float, str]:
        """Months until recalibration at this risk, and the parameter that determines it; nan without three dated entries."""
        of_unit = [trend for trend in self.trends if leaf_of(trend.name) != MOUNTING]
        due = [(trend.months_until(risk, self.months), trend.name) for trend in of_unit]
        known = [pair for pair in due if np.isfinite(pair[0])]
        return min(known) if known else (float("nan"), "")


def unit_history(entries: Sequence[Entry], limits: Mapping[str, float]) -> UnitHistory:
    """Evaluate the entries of a unit.

    Of several results of the same data (a calibration, then a diagnosis) only the last is used: repeats must be independent.
    """
    latest = {entry.sha256 or str(entry.number): entry for entry in entries if entry.parameters is not None}
    chosen = sorted(latest.values(), key=lambda entry: (entry.date_utc, entry.number))
    estimates = [entry.parameters for entry in chosen if entry.parameters is not None]
    if not estimates:
        return UnitHistory((), (), ())
    names = [name for name in estimates[0].names if all(name in estimate.names for estimate in estimates)]
    of_unit = [name for name in names if leaf_of(name) != MOUNTING]
    tests = len(of_unit) + len({leaf_of(name) for name in of_unit})
    level = 1 - TOGETHER ** (1 / max(tests, 1))  # Sidak 1967
    months, trends, repeats = months_of([entry.when for entry in chosen]), list[Trend](), list[Repeatability]()
    for leaf in GROUPS:
        if not (of_leaf := [name for name in names if leaf_of(name) == leaf]):
            continue
        parts = [estimate.of(of_leaf) for estimate in estimates]
        values, sd = (np.stack([getattr(part, of) for part in parts], axis=1) for of in ("values", "sd"))
        dof, covered = np.stack([part.effective_dof for part in parts], axis=1), 2 * float(ndtr(COVERAGE)) - 1
        # Coverage factors at 95.45 %, 2 for known noise.
        factors = np.where(np.isfinite(dof), coverage_factors(dof, covered), COVERAGE)
        u = (expanded := factors * sd) / COVERAGE
        # An estimated uncertainty may be small by chance: as a weight it is at least the median.
        u = np.where(factors > COVERAGE, np.maximum(u, np.median(u, axis=1, keepdims=True)), u)
        with single_blas_thread():
            kind = over_time(values, u, months, 0.0 if leaf == MOUNTING else level)
        together = np.hypot(expanded, COVERAGE * kind.between)
        together = np.where(sd[:, 1:] + sd[:, :-1] > 0, np.hypot(together[:, 1:], together[:, :-1]), np.nan)
        scatter = np.sqrt(kind.between**2 + np.mean(sd**2, axis=1))
        numbers = np.column_stack([kind.p_values, scatter, kind.slopes]).tolist()
        en = np.diff(values) / together
        for k, name in enumerate(of_leaf):
            arrays = (values[k], sd[k], expanded[k], kind.fitted[k], kind.changes[k])
            trends.append(Trend(name, GROUPS[leaf][1], limits[leaf], kind.dof, *arrays, en[k], *numbers[k]))
        largest = float(np.max(np.ptp(values - kind.fitted, axis=1)))
        stated = float(np.median(expanded)) / COVERAGE
        repeats.append(Repeatability(leaf, kind.repeatability, kind.between, stated, kind.dof, largest, limits[leaf]))
    return UnitHistory(tuple(chosen), tuple(trends), tuple(repeats))


def months_of(dates: Sequence[datetime]) -> Float[np.ndarray, " entries"]:
    """Months from the first date to each."""
    return np.array([(date - dates[0]).total_seconds() / 86400 / DAYS_A_MONTH for date in dates])
