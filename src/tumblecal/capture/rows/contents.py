"""The contents of a recording, accumulated while it is written: rows, clock, temperature, gaps, damage."""

from dataclasses import dataclass, field

import numpy as np
import polars as pl

from tumblecal.capture.columns.roles import ColumnLayout
from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.table import Reader, SourceTable
from tumblecal.capture.rows.row_order import usual_step
from tumblecal.capture.still.blocks import LONGEST_STEP_S
from tumblecal.data.joined_clocks import TIME_BEGAN, TIME_ZERO, moment


# Keys of comments that state the sample rate.
RATE_KEYS = (
    *("rate_hz", "fs", "fs_hz", "sample_rate", "sampling_rate", "sampling_rate_hz", "sampling_frequency"),
    *("update_rate", "outputrate"),
)
# Clocks with more seconds count from 1970: the date is after 2001, and no device has run for that long.
_LEAST_MOMENT_S = 1e9


@dataclass
class Contents:
    """The contents of a recording, accumulated while it is written.

    `rate_hz` is None if neither times nor a statement give it. `unreadable` counts excluded rows, `places` are their places,
    and `first_unread` names the column of the first; `damage` lists missing and changed rows.
    `begin_s` is the reading of the clock at time zero, s.
    `gaps` are (time, length) in s of time steps of more than half a second, or backwards. `equal_times` counts rows with the
    time of the row before. `samples_per_row` is below 1 if the rows of a file without times repeat.
    """

    reader: Reader
    tables: list[SourceTable]
    layout: ColumnLayout
    options: RecordingOptions
    damage: Damage
    rows: int = 0
    unreadable: int = 0
    places: list[int] = field(default_factory=list)
    first_unread: str = ""
    first_s: float = np.nan
    last_s: float = np.nan
    gaps: list[tuple[float, float]] = field(default_factory=list)
    temperature: tuple[float, float] = (np.inf, -np.inf)
    begin_s: float = np.nan
    without_temperature: int = 0
    equal_times: int = 0
    samples_per_row: float = 1.0
    _step_s: float = np.nan
    _lost: int = 0
    _sum_s: float = 0.0
    _steps: int = 0
    _rates: list[float] = field(default_factory=list)

    @property
    def rate_hz(self) -> float | None:
        """Samples a second, excluding gaps."""
        if self._sum_s > 0:
            return self._steps / self._sum_s
        stated = self.options.rate or _stated_rate(self.layout.table)
        return stated and stated * self.samples_per_row

    @property
    def slow_hz(self) -> float | None:
        """Samples a second of a log most of whose steps are longer than `LONGEST_STEP_S`; None for others."""
        steps = [length for _, length in self.gaps if length > 0]
        return 1 / float(np.median(steps)) if len(steps) > self._steps else None

    @property
    def missing(self) -> int:
        """Number of missing samples of a regular clock, in all steps of more than 1.5 usual steps."""
        return max(0, self._lost - self.equal_times)

    def uncounted(self) -> "Contents":
        """A copy with all row counts reset, to count again after a repair."""
        known = {
            name: getattr(self, name) for name in ("unreadable", "places", "first_unread", "begin_s", "samples_per_row")
        }
        return Contents(self.reader, self.tables, self.layout, self.options, self.damage, **known)

    @property
    def clock_comments(self) -> dict[str, str]:
        """Comments that state when the times were zero, for `data.joined_clocks`: a date if the clock counts from 1970."""
        if not np.isfinite(self.begin_s):
            return {}
        if self.begin_s < _LEAST_MOMENT_S:
            return {TIME_BEGAN: f"{self.begin_s:.6f}"}
        return {TIME_ZERO: moment(self.begin_s)}

    @property
    def entries(self) -> dict[str, object]:
        """Excluded rows and damage, for a file."""
        return {
            "left_out": {"rows": self.unreadable, "first": self.places},
            "damage": self.damage.lines,
            "damage_records": [record.as_dict() for record in self.damage.records],
        }

    @property
    def mixed_rates(self) -> tuple[float, float] | None:
        """Lowest and highest rate in Hz, if they differ by more than a fifth."""
        if not self._rates or max(self._rates) < 1.2 * min(self._rates):
            return None
        return min(self._rates), max(self._rates)

    def add(self, frame: pl.DataFrame) -> None:
        """Count a piece."""
        self.rows += len(frame)
        if "temperature_degc" in frame.columns:
            known = frame["temperature_degc"].drop_nans().drop_nulls()
            self.without_temperature += len(frame) - len(known)
            if len(known):
                low, high = self.temperature
                self.temperature = min(low, known.min()), max(high, known.max())  # type: ignore[type-var, assignment]
        if "time_s" in frame.columns and len(frame):
            self._add_times(frame["time_s"].to_numpy())

    def _add_times(self, times: np.ndarray) -> None:
        began = np.isfinite(self.first_s)
        steps = np.diff(times, prepend=self.last_s) if began else np.diff(times)
        self.first_s, self.last_s = self.first_s if began else times[0], times[-1]
        whole = (steps >= 0) & (steps <= LONGEST_STEP_S)
        at = times[len(times) - len(steps) :]
        self.gaps += [(float(at[k]), float(steps[k])) for k in np.flatnonzero(~whole)]
        self._sum_s += float(steps[whole].sum())
        self._steps += int(whole.sum())
        self.equal_times += int(np.count_nonzero(steps == 0))
        if np.isnan(self._step_s):
            self._step_s = usual_step(times)
        if self._step_s:
            self._lost += int((np.round(steps[steps > 1.5 * self._step_s] / self._step_s) - 1).sum())
        for part in np.array_split(np.where(whole, steps, np.nan), max(1, len(steps) // 1000)):
            if len(part) >= 500 and np.nansum(part) > 0:
                self._rates.append(float(1 / np.nanmean(part)))


def _stated_rate(table: SourceTable) -> float | None:
    for key in RATE_KEYS:
        try:
            return float(table.comments[key].lower().removesuffix("hz"))
        except (KeyError, ValueError):
            continue
    return None
