"""Process noise between a calibration and a check: changes of the parameters by the history of the unit, or as stated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Annotated

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.joined_clocks import TIME_ZERO
from tumblecal.data.position_comments import MEASURED, measured_at
from tumblecal.data.positions import PositionSet
from tumblecal.data.sensor_parameters import SENSOR, leaf_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.record import ResultRecord, by_name
from tumblecal.history.entry import Entry
from tumblecal.history.repeatability import PAPER_LIMITS, unit_history
from tumblecal.words import sentence


_DAYS_A_MONTH = 365.25 / 12


@dataclass(frozen=True)
class ProcessNoise:
    """Change of the parameters since their calibration: mean `shift` and `variance` (9), base units; `source` in words."""

    shift: Float[np.ndarray, "9"]
    variance: Float[np.ndarray, "9"]
    months: float | None
    source: str

    @property
    def sd(self) -> Float[np.ndarray, "9"]:
        """Standard deviations, base units."""
        return np.sqrt(self.variance)


class ProcessNoiseRecord(ResultRecord):
    """`ProcessNoise` in the provenance of an update."""

    source: str
    months: float | None
    shift: Annotated[dict[str, float], by_name(SENSOR)]
    sd: Annotated[dict[str, float], by_name(SENSOR)]


def no_noise(history: str = "", results: int = 0) -> ProcessNoise:
    """No process noise: nothing is stated, or the `history` has too few dated results."""
    words = sentence("check/drift_none", history=history, results=results)
    return ProcessNoise(np.zeros(9), np.zeros(9), None, words)


def months_between(calibration: Calibration, data: PositionSet, now: datetime) -> float | None:
    """Months from the measurement of a calibration to a recording (by default `now`); None if the calibration has no date."""
    stated = calibration.provenance.get(MEASURED) or calibration.provenance.get("date_utc")
    if stated is None:
        return None
    recorded = data.comments.get(MEASURED) or data.comments.get(TIME_ZERO)
    at = now if recorded is None else _in_utc(measured_at(recorded, data.source), now)
    since = _in_utc(measured_at(str(stated), "date of the calibration"), now)
    return max((at - since).total_seconds() / 86400 / _DAYS_A_MONTH, 0.0)


def _in_utc(date: datetime, now: datetime) -> datetime:
    return date if date.tzinfo is not None else date.replace(tzinfo=now.tzinfo)


def by_parameter(sizes: Mapping[str, float]) -> Float[np.ndarray, "9"]:
    """Sizes by leaf or parameter as one for each parameter; 0 for those that are not stated."""
    return np.array([sizes.get(name, sizes.get(leaf_of(name), 0.0)) for name in SENSOR])


def stated_noise(rates: Mapping[str, float], months: float) -> ProcessNoise:
    """Process noise from standard deviations per month (base units) by leaf or parameter: a change grows in proportion to time,
    with an unknown rate."""
    sd = by_parameter(rates) * months
    words = sentence("check/drift", of=", ".join(rates), history="", months=months)
    return ProcessNoise(np.zeros(9), sd**2, months, words)


def process_noise(
    calibration: Calibration,
    data: PositionSet,
    rates: Mapping[str, float],
    months: float | None,
    entries: Sequence[Entry] | None,
    named: str,
) -> ProcessNoise:
    """The process noise between a calibration and a recording: as stated, otherwise by the history of the unit, otherwise none.

    **Arguments:**

    - `rates`: stated drifts, as for `stated_noise`. `months`: between the two; by default by their dates.
    - `entries`: of the unit in the history `named`; None without a history or a serial number.

    **Raises:** `InputError` for a drift without a time.
    """
    between = months_between(calibration, data, datetime.now(UTC)) if months is None else months
    if rates:
        if between is None:
            raise InputError("--drift: the calibration states no date; give the time since then: --months 12")
        return stated_noise(rates, between)
    if entries is None or between is None:
        return no_noise()
    return noise_of_history(entries, between, named)


def noise_of_history(entries: Sequence[Entry], months: float, named: str) -> ProcessNoise:
    """Process noise from the earlier results of a unit: its drift per month with its uncertainty, and the dispersion about the
    line beyond the uncertainty of the results; none with fewer than three dated results."""
    history = unit_history(entries, PAPER_LIMITS)
    trends = {trend.name: trend for trend in history.trends}
    count = len(history.entries)
    if any(name not in trends or not np.isfinite(trends[name].drift) for name in SENSOR):
        return no_noise(named, count)
    shift, variance = np.zeros(9), np.zeros(9)
    for number, name in enumerate(SENSOR):
        trend = trends[name]
        shift[number] = trend.drift * months
        beyond = trend.scatter**2 - float(np.mean(trend.sd**2))
        variance[number] = (trend.drift_sd * months) ** 2 + max(beyond, 0.0)
    words = sentence("check/drift", of=f"{count} results", history=named, months=months)
    return ProcessNoise(shift, variance, months, words)
