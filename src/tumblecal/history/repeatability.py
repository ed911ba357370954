"""A unit over time: run-to-run differences, repeatability, drift, and the recalibration interval."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtr, stdtr

from tumblecal.data.coverage_factor import coverage_factors
from tumblecal.data.sensor_parameters import GROUPS, SENSOR, SensorParameters, leaf_of
from tumblecal.history.control_chart import beyond_by_chance, control_limit
from tumblecal.history.entry import Entry
from tumblecal.history.few_dof import joint_dof, no_change, no_difference


# Limits of the paper for differences between repeats (section 4), base units: 5e-4, 1.5 mg, 2 mrad, 5 mrad.
PAPER_LIMITS = {"dK": 5e-4, "bias": 1.5e-3, "gamma": 2e-3, "dtheta": 5e-3}
# Significance level of differences between repeats.
UNLIKELY = 0.001
COVERAGE = 2.0  # k of the expanded uncertainties in E_n and on the charts, for known noise
# Probability that all E_n of a unit are within their common limit, without a change.
TOGETHER = 0.95
_DAYS_A_MONTH = 365.25 / 12


@dataclass(frozen=True)
class Trend:
    """One parameter over time, base units.

    - `values`, `sd`: of each entry (sd 0: not stated). `expanded`: their uncertainty at 95.45 %, with Student's k for
      estimated noise. `mean`; `control`: half width of the control limits, nan for less than four entries; `beyond`:
      probability, without a change, of an entry as far beyond them, 1 within.
    - `en`: E_n of each entry and the previous one (ISO 13528). `tail`: p-value of that difference; `by_chance`: probability of
      |E_n| > 1 without a change; nan without sd.
    - `largest`: the largest difference of two entries, `limit`: its limit.
    - `drift`, `drift_sd`: per month; `scatter`: dispersion about that line, with `dof` degrees of freedom (those of the noise
      if the stated sd explain it); nan with less than three entries over time.
    """

    name: str
    unit: str
    values: Float[np.ndarray, " entries"]
    sd: Float[np.ndarray, " entries"]
    mean: float
    control: float
    beyond: Float[np.ndarray, " entries"]
    expanded: Float[np.ndarray, " entries"]
    en: Float[np.ndarray, " steps"]
    tail: Float[np.ndarray, " steps"]
    by_chance: Float[np.ndarray, " steps"]
    limit: float
    drift: float
    drift_sd: float
    scatter: float
    dof: float

    @property
    def largest(self) -> float:
        """The largest difference of two entries."""
        return float(np.ptp(self.values))

    @property
    def outside(self) -> Bool[np.ndarray, " entries"]:
        """Entries beyond the control limits."""
        return np.abs(self.values - self.mean) > self.control if self.control > 0 else np.zeros(len(self.values), bool)

    def months_until(self, risk: float, longest: float) -> float:
        """Months after which the parameter exceeds its limit with probability `risk`, at most `longest`.

        The change after t months has a Student distribution about drift t, with the sd of the drift and the dispersion about
        the line.
        """
        if not np.isfinite(self.drift):
            return float("nan")
        dof = min(self.dof, 1e9)

        def beyond(months: float) -> float:
            sd = float(np.hypot(self.drift_sd * months, self.scatter)) or 1e-300
            centre = self.drift * months
            return float(stdtr(dof, (-self.limit - centre) / sd) + 1 - stdtr(dof, (self.limit - centre) / sd))

        if beyond(0.0) > risk:
            return 0.0
        low, high = 0.0, longest
        if beyond(longest) <= risk:
            return longest
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if beyond(middle) <= risk else (low, middle)
        return low


@dataclass(frozen=True)
class Repeats:
    """Agreement of repeats for one kind of parameter: largest difference and its limit, and chi-square of no difference (p None
    if an entry has no uncertainty), with p for the degrees of freedom of the noise of each entry."""

    what: str
    unit: str
    largest: float
    limit: float
    chi2: float
    dof: int
    p_value: float | None

    @property
    def beyond_limit(self) -> bool:
        """Whether two entries differ by more than the limit."""
        return self.largest > self.limit

    @property
    def beyond_noise(self) -> bool:
        """Whether the entries disagree beyond their uncertainties."""
        return self.p_value is not None and self.p_value < UNLIKELY


@dataclass(frozen=True)
class UnitHistory:
    """Evaluation of a unit: the independent entries, trends by parameter, repeatability by kind."""

    entries: tuple[Entry, ...]
    trends: tuple[Trend, ...]
    repeats: tuple[Repeats, ...]

    @property
    def months(self) -> float:
        """Time from the first to the last entry, months."""
        return months_of([entry.when for entry in self.entries])[-1] if self.entries else 0.0

    @property
    def unlikely_together(self) -> float:
        """Significance level of a difference of two entries, for all parameters and entries together (Sidak 1967)."""
        return unlikely_among(sum(int(np.isfinite(trend.en).sum()) for trend in self.trends))

    @property
    def unlikely_on_charts(self) -> float:
        """Significance level of an entry beyond its control limits, whose p-value is for its whole chart."""
        return unlikely_among(sum(trend.control > 0 for trend in self.trends))

    def interval(self, risk: float) -> tuple[float, str]:
        """Months until recalibration at this risk, and the parameter that determines it; nan without three dated entries."""
        due = [
            (trend.months_until(risk, self.months), trend.name)
            for trend in self.trends
            if leaf_of(trend.name) != "dtheta"
        ]
        known = [pair for pair in due if np.isfinite(pair[0])]
        return min(known) if known and self.months > 0 else (float("nan"), "")


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
    common = [estimate.of(names) for estimate in estimates]
    months = months_of([entry.when for entry in chosen])
    trends = tuple(_trend(common, k, months, limits) for k in range(len(names)))
    return UnitHistory(tuple(chosen), trends, tuple(_repeats(common, limits)))


def unlikely_among(count: int) -> float:
    """Significance level of each of `count` tests for a family-wise error rate of 1 - `TOGETHER` (Sidak 1967)."""
    return 1 - TOGETHER ** (1 / max(count, 1))


def months_of(dates: Sequence[datetime]) -> Float[np.ndarray, " entries"]:
    """Months from the first date to each."""
    return np.array([(date - dates[0]).total_seconds() / 86400 / _DAYS_A_MONTH for date in dates])


def _trend(estimates: Sequence[SensorParameters], k: int, months: np.ndarray, limits: Mapping[str, float]) -> Trend:
    name = estimates[0].names[k]
    values, sd = np.array([part.values[k] for part in estimates]), np.array([part.sd[k] for part in estimates])
    dofs = np.array([part.effective_dof[k] for part in estimates])
    steps = np.abs(np.diff(values))
    expanded = np.where(np.isfinite(dofs), coverage_factors(dofs, 2 * float(ndtr(COVERAGE)) - 1), COVERAGE) * sd
    together = np.hypot(expanded[1:], expanded[:-1])
    en = np.divide(np.diff(values), together, out=np.full(len(steps), np.nan), where=together > 0)
    leaf = leaf_of(name)
    mean, line = float(np.mean(values)), _line(months, values, sd, dofs)
    return Trend(
        name,
        GROUPS[leaf][1],
        values,
        sd,
        mean,
        control_limit(values),
        beyond_by_chance(values, sd),
        expanded,
        en,
        _tails(steps, sd, dofs),
        _by_chance(together, sd, dofs),
        limits[leaf],
        *line,
    )


def _tails(steps: np.ndarray, sd: np.ndarray, dofs: np.ndarray) -> Float[np.ndarray, " steps"]:
    """The p-value of the difference of each entry and the previous one; nan without sd."""
    together = np.hypot(sd[1:], sd[:-1])
    in_sd = np.divide(steps, together, out=np.full(len(steps), np.nan), where=together > 0)
    tails = 2 * ndtr(-in_sd)
    for k in np.flatnonzero((together > 0) & (np.isfinite(dofs[1:]) | np.isfinite(dofs[:-1]))):
        variances = [sd[place : place + 1, None] ** 2 for place in (k, k + 1)]
        tails[k] = no_change(steps[k : k + 1], variances, dofs[k : k + 2].tolist())[2]
    return tails


def _by_chance(together: np.ndarray, sd: np.ndarray, dofs: np.ndarray) -> Float[np.ndarray, " steps"]:
    """Probability of |E_n| > 1 without a change, by Welch and Satterthwaite (JCGM 100, G.4); nan without sd."""
    variance, spent = sd[1:] ** 2 + sd[:-1] ** 2, sd[1:] ** 4 / dofs[1:] + sd[:-1] ** 4 / dofs[:-1]
    dof = np.divide(variance**2, spent, out=np.full(len(spent), np.inf), where=spent > 0)
    beyond = np.divide(together, np.sqrt(variance), out=np.full(len(spent), np.nan), where=variance > 0)
    return np.where(np.isfinite(dof), 2 * stdtr(np.minimum(dof, 1e9), -beyond), 2 * ndtr(-beyond))


def _line(
    months: np.ndarray, values: np.ndarray, sd: np.ndarray, dofs: np.ndarray
) -> tuple[float, float, float, float]:
    """Slope, its sd, dispersion and its degrees of freedom, by weighted least squares.

    The sd is enlarged if the dispersion is larger than the stated sd explain, and for the uncertainty of estimated weights
    (Meier 1953, Biometrics 9, 59, for a mean; Kenward and Roger 1997, Biometrics 53, 983).
    """
    if len(values) < 3 or np.ptp(months) <= 0:
        return float("nan"), float("nan"), float("nan"), float("nan")
    weights = 1 / sd if np.all(sd > 0) else np.ones(len(values))
    design = np.column_stack([np.ones(len(months)), months]) * weights[:, None]
    line, *_ = np.linalg.lstsq(design, values * weights, rcond=None)
    covariance = np.linalg.inv(design.T @ design)
    moved = covariance @ design.T  # line by the weighted values
    residual_share = 1 - np.sum(design.T * moved, axis=0)
    covariance = covariance + moved @ ((4 * residual_share / dofs)[:, None] * moved.T) if np.all(sd > 0) else covariance
    residual = values - line[0] - line[1] * months
    ratio = np.sqrt(np.sum((residual * weights) ** 2) / (len(values) - 2))
    explained = bool(np.all(sd > 0)) and ratio <= 1.0
    slope_sd = (1.0 if explained else ratio) * np.sqrt(covariance[1, 1])
    scatter = float(np.mean(sd)) if explained else float(np.sqrt(np.sum(residual**2) / (len(values) - 2)))
    spent = float(np.sum(moved[1] ** 4 / dofs))
    noise_dof = float(np.sum(moved[1] ** 2)) ** 2 / spent if spent > 0 else float("inf")
    return float(line[1]), float(slope_sd), scatter, noise_dof if explained else len(values) - 2.0


def _repeats(estimates: Sequence[SensorParameters], limits: Mapping[str, float]) -> list[Repeats]:
    names = estimates[0].names
    rows = []
    for leaf, (what, unit) in GROUPS.items():
        chosen = [name for name in names if leaf_of(name) == leaf]
        if chosen:
            parts = [estimate.of(chosen) for estimate in estimates]
            largest = max(float(np.ptp([part.values[k] for part in parts])) for k in range(len(chosen)))
            rows.append(Repeats(what, unit, largest, limits[leaf], *_homogeneity(parts)))
    sensor = [estimate.of([name for name in names if name in SENSOR]) for estimate in estimates]
    return [*rows, Repeats("whole sensor", "", 0.0, float("inf"), *_homogeneity(sensor))]


def _homogeneity(parts: Sequence[SensorParameters]) -> tuple[float, int, float | None]:
    """Chi-square of the parts about their weighted mean, its degrees of freedom and tail."""
    if len(parts) < 2 or not all(np.all(part.sd > 0) for part in parts):
        return 0.0, 0, None
    every = np.eye(len(parts[0].names))
    dofs = [joint_dof(part, every) for part in parts]
    return no_difference(np.stack([part.values for part in parts]), [part.covariance for part in parts], dofs)
