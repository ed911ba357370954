"""A recording of any format as one table of samples in SI units, and what the file states about it."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.data.joined_clocks import TIME_BEGAN, TIME_ZERO, moment
from tumblecal.data.parquet import scan_parquet
from tumblecal.ground.gravity import comments_of, gravity_of_option
from tumblecal.recordings.columns import RATE_KEYS, Layout
from tumblecal.recordings.damage import Damage
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.rows import Unread
from tumblecal.recordings.table import Reader, Table


# Clocks with more seconds count from 1970.
_LEAST_MOMENT_S = 1e9


@dataclass(frozen=True)
class Recording:
    """A recording: its samples, and the evidence for their columns.

    **Arguments:**

    - `path`: the source. `reader`, `tables`, `table`: its format, its tables, and the one that was read.
    - `options`: as given. `layout`: columns, units, size of gravity, notes. `damage`: missing and suspicious rows.
    - `unread`: rows without a complete reading. The rest is known after the rows were read:
    - `samples`: the table of samples, a Parquet file: `time_s` from 0, `ax_g` (or `_mg, _ms2, _counts`) .., `gx_dps` ..,
      `temperature_degc`, `position` .. `rows`: their number.
    - `rate_hz`: samples a second, by the times without gaps, as asked for, or as the file states it; None if unknown.
      `slow_hz`: that of a log most of whose steps are gaps for others; None for others.
    - `begin_s`: the source's clock at time zero, `last_s`: the last time, s. `gaps`: time and length, s, of steps of more than
      half a second, or backwards. `equal_times`: samples with the time of the one before. `missing`: samples that a regular
      clock lacks. `mixed_rates`: lowest and highest rate, if they differ by more than a fifth.
    - `temperature`: lowest and highest, degC, and the number of samples without one; None without a temperature.
    """

    path: Path
    reader: Reader
    tables: list[Table]
    table: Table
    options: RecordingOptions
    layout: Layout
    damage: Damage
    unread: Unread = field(default_factory=Unread)
    samples: Path = Path()
    rows: int = 0
    rate_hz: float | None = None
    slow_hz: float | None = None
    begin_s: float = np.nan
    last_s: float = np.nan
    gaps: tuple[tuple[float, float], ...] = ()
    equal_times: int = 0
    missing: int = 0
    mixed_rates: tuple[float, float] | None = None
    temperature: tuple[float, float, int] | None = None

    def frame(self) -> pl.LazyFrame:
        """The samples, not read yet."""
        return scan_parquet(self.samples, check=False)[0]

    @property
    def clock_comments(self) -> dict[str, str]:
        """Comments that state when the times were zero: a date if the clock counts from 1970."""
        if not np.isfinite(self.begin_s):
            return {}
        dated = self.begin_s >= _LEAST_MOMENT_S
        return {TIME_ZERO: moment(self.begin_s)} if dated else {TIME_BEGAN: f"{self.begin_s:.6f}"}

    @property
    def comments(self) -> dict[str, str]:
        """Comments of the table of samples: what the source states, gravity, rate, and its name."""
        comments = {key: value for key, value in self.table.stated.items() if key not in RATE_KEYS}
        if self.layout.per_g:
            comments["counts_per_g"] = f"{self.layout.per_g:g}"
        if self.rate_hz and "time" not in self.layout.columns:
            comments["rate_hz"] = f"{self.rate_hz:g}"
        gravity = comments_of(gravity_of_option(self.options.gravity)) if self.options.gravity else {}
        return comments | gravity | {"imported_from": self.path.name}

    @property
    def entries(self) -> dict[str, object]:
        """Rows that are left out and damage, for a file."""
        return {
            "left_out": self.unread,
            "damage": self.damage.lines,
            "damage_records": self.damage.records,
        }
