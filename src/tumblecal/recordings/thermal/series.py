"""A recording over temperature in blocks: time, accelerations, temperature, and the attitude of each."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float

from tumblecal.recordings.thermal.smoothed_temperature import smoothed


# Sums of squared deviations from the accelerations of a block, g^2; temperature, degC, and its rate, degC/s.
SQUARES = ["ax_squares", "ay_squares", "az_squares"]
TEMPERATURE, RATE = "temperature_degc", "rate_degc_per_s"


@dataclass(frozen=True)
class ThermalSeries:
    """The blocks at rest of one recording, or of its part between two restarts of the clock.

    - `clock`: label of the recording, or of its part. `source`: its file. `comments`: gravity, serial number and others.
    - `block_s`: length of a block, s; `size`: its samples. `quantum` (3): smallest step of the readings, g; 0 if unknown.
    - `visits`: a row for each stay: `position`, `alpha_deg`, `beta_deg`, `mount`; null if unknown.
    - `blocks`: a row for each block at rest: `time_s` (middle, s), `ax_g` .. (mean, g), `SQUARES`, `visit` (number of the stay
      in one attitude), `TEMPERATURE` and `RATE` (smoothed).
    - `course`: smoothed temperature of the whole recording, including movements, on cells of `cell_s`, s (`smoothed`).
      `resolution`, `noise`: of the thermometer, degC.
    """

    clock: str
    source: str
    comments: dict[str, str]
    block_s: float
    size: int
    quantum: Float[np.ndarray, "3"]
    visits: pl.DataFrame
    blocks: pl.DataFrame
    course: pl.DataFrame
    cell_s: float
    noise: float
    resolution: float

    @classmethod
    def of(cls, recorded: pl.DataFrame, **known: Any) -> "ThermalSeries":
        """A series from all blocks with a temperature, those of movements with `visit` -1.

        **Arguments:** `known`: the fields that do not follow from these.
        """
        course, cell_s, noise = smoothed(
            recorded["time_s"].to_numpy(), recorded[TEMPERATURE].to_numpy(), known["resolution"]
        )
        blocks = recorded.filter(pl.col("visit") >= 0)
        at = {name: np.interp(blocks["time_s"], course["time_s"], course[name]) for name in (TEMPERATURE, RATE)}
        return cls(blocks=blocks.with_columns(**at), course=course, cell_s=cell_s, noise=noise, **known)
