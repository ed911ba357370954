"""Readings over temperature: one row for each attitude, branch of the temperature, and temperature bin or soak."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Bool

from tumblecal.data.position_comments import ATTITUDES, UNKNOWN


READINGS, SDS, INDEPENDENT = ([f"a{axis}{suffix}" for axis in "xyz"] for suffix in ("_g", "_sd_g", "_n_eff"))
COLUMNS = ("position", "branch", "run", "mount", "alpha_deg", "beta_deg", "n", "temperature_degc", "time_s",
           "rate_degc_per_s", "direction", "reached_by", *READINGS, *SDS, *INDEPENDENT)  # fmt: skip


def _column(name: str, *more: str) -> "cached_property[Any]":
    """A column as an array (rows), several as an array (rows, columns), labels as a tuple; None if it is absent."""

    def values(table: "ThermalTable") -> Any:
        if name not in table.frame.columns:
            return None
        if more:
            return table.frame.select(name, *more).to_numpy(order="c")
        column = table.frame[name]
        return tuple(column) if column.dtype == pl.String else column.to_numpy()

    return cached_property(values)


@dataclass(frozen=True)
class ThermalTable:
    """Means of readings over temperature, in rows of equal weight over temperature.

    **Arguments:**

    - `frame`: a row for each mean, with the names and the units of a position file (`COLUMNS`). `source`: name of the
      recordings, `files`: their paths. `comments`: stated gravity, serial number and others, as of a position file.

    **Columns**, as arrays (rows) and labels:

    - `attitude` (column `position`): label; rows with one label have the same direction of gravity. `readings` (rows, 3): g.
    - `sd` (rows, 3): standard deviation of each mean at its temperature, g, with the autocorrelation of the noise, the rounding
      of readings, and the noise and resolution of the thermometer. It is relative to the rows before and after: slower noise is
      common to neighbours.
    - columns `n`: samples of each row; `ax_n_eff` ..: number of independent samples with the same noise of the mean.
    - `temperature_degc`, `rate_degc_per_s`: means of the smoothed temperature and of its rate. `time_s`: middle, by the clock
      `clock` (column `run`: label of a recording, or of its part after a restart of the clock); times of different clocks are
      not comparable.
    - `branch`: label of the monotonic stretch of the temperature (`file:1 up`), to which its soaks belong.
    - `direction`: +1 while the temperature rises, -1 while it falls, 0 in a soak. `reached_by`: +1 if the stretch of the row
      rises (a soak reached from a lower temperature), -1 if it falls, 0 if the temperature does not change.
    - `alpha_deg`, `beta_deg`: angles of the attitude; None if attitudes are unknown. `mount`: label of the mounting, or None.
    """

    frame: pl.DataFrame
    source: str = "recording"
    comments: dict[str, str] = field(default_factory=dict)
    files: tuple[str, ...] = ()

    attitude = _column("position")
    branch = _column("branch")
    clock = _column("run")
    mount = _column("mount")
    alpha_deg = _column("alpha_deg")
    beta_deg = _column("beta_deg")
    temperature_degc = _column("temperature_degc")
    time_s = _column("time_s")
    rate_degc_per_s = _column("rate_degc_per_s")
    direction = _column("direction")
    reached_by = _column("reached_by")
    readings = _column(*READINGS)
    sd = _column(*SDS)

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def known_attitudes(self) -> bool:
        """Whether the angles of the attitudes are known."""
        return self.alpha_deg is not None

    @property
    def attitudes(self) -> tuple[str, ...]:
        """The attitudes, in the order of their first rows."""
        return tuple(dict.fromkeys(self.attitude))

    @property
    def means_by_attitude(self) -> pl.DataFrame:
        """The mean readings, g, of each attitude (`position`)."""
        return self.frame.group_by("position", maintain_order=True).agg(pl.col(READINGS).mean())

    @property
    def range_degc(self) -> tuple[float, float]:
        """Lowest and highest temperature of a row."""
        return float(self.temperature_degc.min()), float(self.temperature_degc.max())

    @property
    def soak(self) -> np.ndarray:
        """Mask of the rows of soaks."""
        return self.direction == 0

    def rows(self, mask: Bool[np.ndarray, " rows"]) -> "ThermalTable":
        """The rows of a mask."""
        return replace(self, frame=self.frame.filter(mask))


def joined(tables: Sequence[ThermalTable]) -> ThermalTable:
    """The rows of several tables, with the columns that all of them have, and the comments that are the same in all. The
    comment of unknown attitudes depends on the angles alone."""
    first, *others = tables
    frame = pl.concat((table.frame for table in tables), how="diagonal_relaxed")
    known = [name for name in COLUMNS if name in frame.columns and not frame[name].null_count()]
    same = {key: text for key, text in first.comments.items() if all(t.comments.get(key) == text for t in others)}
    same.pop(ATTITUDES, None)
    if "alpha_deg" not in known:
        same[ATTITUDES] = UNKNOWN
    source = first.source + (f" and {len(others)} more" if others else "")
    return ThermalTable(frame.select(known), source, same, tuple(dict.fromkeys(table.source for table in tables)))
