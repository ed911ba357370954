"""A unit over time: run-to-run differences, criteria of repeatability, drift, and when to calibrate again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaincc, stdtr

from tumblecal.data.sensor_parameters import GROUPS, SENSOR, SensorParameters, leaf_of
from tumblecal.history.comparison import weighed
from tumblecal.history.entry import Entry


# Largest differences between repeats that the paper allows (section 4), base units: 5e-4, 1.5 mg, 2 mrad, 5 mrad.
PAPER_LIMITS = {"dK": 5e-4, "bias": 1.5e-3, "gamma": 2e-3, "dtheta": 5e-3}
# Repeats that their uncertainties explain no better than this differ more than they may.
UNLIKELY = 0.001
COVERAGE = 2.0  # k of the expanded uncertainties in E_n and on the charts
_DAYS_A_MONTH = 365.25 / 12
# Individuals chart: three standard deviations from the mean moving range (ISO 7870-2), 3 / 1.128.
_MOVING_RANGE = 3 / 1.128
_FEWEST_FOR_CHART = 4


@dataclass(frozen=True)
class Trend:
    """One parameter over time, base units.

    - `values`, `sd`: of each entry (sd 0: not stated). `mean`; `control`: half width of the control limits, nan for less
      than four entries.
    - `en`: E_n of each entry against the one before. `largest`: the largest difference of two entries, `limit` what is allowed.
    - `drift`, `drift_sd`: a month; `scatter`: about that line, with `dof` degrees of freedom (infinite where the stated sd
      explain it); nan where there are no three entries over time.
    """

    name: str
    unit: str
    values: Float[np.ndarray, " entries"]
    sd: Float[np.ndarray, " entries"]
    mean: float
    control: float
    en: Float[np.ndarray, " steps"]
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
        """Months after which the parameter has moved by more than its limit with probability `risk`, at most `longest`.

        The change after t months is taken as Student's t around drift t, with the drift's sd and the scatter about the line.
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
    """Whether repeats agree, of one kind of parameter: largest difference against what is allowed, and chi-square of no
    difference (p None where an entry has no uncertainty)."""

    what: str
    unit: str
    largest: float
    limit: float
    chi2: float
    dof: int
    p_value: float | None

    @property
    def beyond_limit(self) -> bool:
        """Whether two entries differ by more than is allowed."""
        return self.largest > self.limit

    @property
    def beyond_noise(self) -> bool:
        """Whether the entries differ by more than their uncertainties explain."""
        return self.p_value is not None and self.p_value < UNLIKELY


@dataclass(frozen=True)
class UnitHistory:
    """All that is said of a unit: the entries that count, trends by parameter, repeatability by kind."""

    entries: tuple[Entry, ...]
    trends: tuple[Trend, ...]
    repeats: tuple[Repeats, ...]

    @property
    def months(self) -> float:
        """From the first entry to the last."""
        return _months([entry.when for entry in self.entries])[-1] if self.entries else 0.0

    def interval(self, risk: float) -> tuple[float, str]:
        """Months until calibration is due at this risk, and the parameter that says so; nan without three dated entries."""
        due = [
            (trend.months_until(risk, self.months), trend.name)
            for trend in self.trends
            if leaf_of(trend.name) != "dtheta"
        ]
        known = [pair for pair in due if np.isfinite(pair[0])]
        return min(known) if known and self.months > 0 else (float("nan"), "")


def unit_history(entries: Sequence[Entry], limits: Mapping[str, float]) -> UnitHistory:
    """What a unit's entries say.

    Of several results of the same data (a calibration, then a diagnosis) the last counts: repeats must be independent.
    """
    latest = {entry.sha256 or str(entry.number): entry for entry in entries if entry.parameters is not None}
    chosen = sorted(latest.values(), key=lambda entry: (entry.date_utc, entry.number))
    estimates = [entry.parameters for entry in chosen if entry.parameters is not None]
    if not estimates:
        return UnitHistory((), (), ())
    names = [name for name in estimates[0].names if all(name in own.names for own in estimates)]
    own = [estimate.of(names) for estimate in estimates]
    months = _months([entry.when for entry in chosen])
    trends = tuple(_trend(own, k, months, limits) for k in range(len(names)))
    return UnitHistory(tuple(chosen), trends, tuple(_repeats(own, limits)))


def _months(dates: Sequence[datetime]) -> Float[np.ndarray, " entries"]:
    return np.array([(date - dates[0]).total_seconds() / 86400 / _DAYS_A_MONTH for date in dates])


def _trend(own: Sequence[SensorParameters], k: int, months: np.ndarray, limits: Mapping[str, float]) -> Trend:
    name = own[0].names[k]
    values, sd = np.array([part.values[k] for part in own]), np.array([part.sd[k] for part in own])
    steps = np.abs(np.diff(values))
    control = _MOVING_RANGE * float(np.mean(steps)) if len(values) >= _FEWEST_FOR_CHART else float("nan")
    together = COVERAGE * np.hypot(sd[1:], sd[:-1])
    en = np.divide(np.diff(values), together, out=np.full(len(steps), np.nan), where=together > 0)
    leaf = leaf_of(name)
    mean, line = float(np.mean(values)), _line(months, values, sd)
    return Trend(name, GROUPS[leaf][1], values, sd, mean, control, en, limits[leaf], *line)


def _line(months: np.ndarray, values: np.ndarray, sd: np.ndarray) -> tuple[float, float, float, float]:
    """Slope, its sd, scatter and its degrees of freedom, by weighted least squares; the sd grows where the scatter is more
    than the stated sd explain."""
    if len(values) < 3 or np.ptp(months) <= 0:
        return float("nan"), float("nan"), float("nan"), float("nan")
    weights = 1 / sd if np.all(sd > 0) else np.ones(len(values))
    design = np.column_stack([np.ones(len(months)), months]) * weights[:, None]
    line, *_ = np.linalg.lstsq(design, values * weights, rcond=None)
    residual = values - line[0] - line[1] * months
    ratio = np.sqrt(np.sum((residual * weights) ** 2) / (len(values) - 2))
    explained = bool(np.all(sd > 0)) and ratio <= 1.0
    slope_sd = (1.0 if explained else ratio) * np.sqrt(np.linalg.inv(design.T @ design)[1, 1])
    scatter = float(np.mean(sd)) if explained else float(np.sqrt(np.sum(residual**2) / (len(values) - 2)))
    return float(line[1]), float(slope_sd), scatter, float("inf") if explained else len(values) - 2.0


def _repeats(own: Sequence[SensorParameters], limits: Mapping[str, float]) -> list[Repeats]:
    names = own[0].names
    rows = []
    for leaf, (what, unit) in GROUPS.items():
        chosen = [name for name in names if leaf_of(name) == leaf]
        if chosen:
            parts = [estimate.of(chosen) for estimate in own]
            largest = max(float(np.ptp([part.values[k] for part in parts])) for k in range(len(chosen)))
            rows.append(Repeats(what, unit, largest, limits[leaf], *_homogeneity(parts)))
    sensor = [estimate.of([name for name in names if name in SENSOR]) for estimate in own]
    return [*rows, Repeats("whole sensor", "", 0.0, float("inf"), *_homogeneity(sensor))]


def _homogeneity(parts: Sequence[SensorParameters]) -> tuple[float, int, float | None]:
    """Chi-square of the parts about their weighted mean, its degrees of freedom and tail."""
    if len(parts) < 2 or not all(np.all(part.sd > 0) for part in parts):
        return 0.0, 0, None
    weights = [np.linalg.pinv(part.covariance, hermitian=True) for part in parts]
    mean = np.linalg.solve(
        np.sum(weights, axis=0), np.sum([w @ p.values for w, p in zip(weights, parts, strict=True)], axis=0)
    )
    pairs = [weighed(part.values - mean, part.covariance) for part in parts]
    chi2, dof = sum(pair[0] for pair in pairs), (len(parts) - 1) * len(mean)
    return chi2, dof, float(gammaincc(dof / 2, chi2 / 2))
