"""A recording over temperature in blocks: time, accelerations, temperature, and the attitude of each."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from tumblecal.recordings.recording import Recording


@dataclass(frozen=True)
class Attitude:
    """An orientation against gravity: its label, mean reading (3), g, and, if known, angles, deg, and label of the mounting."""

    label: str
    mean: Float[np.ndarray, "3"]
    alpha_deg: float | None = None
    beta_deg: float | None = None
    mount: str = ""


@dataclass(frozen=True)
class ThermalSeries:
    """The blocks at rest of one recording, or of its part between two restarts of the clock.

    - `clock`: its label. `block_s`: length of a block, s; `size`: its samples.
    - `time_s` (blocks): middle, s. `force` (blocks, 3): mean, g. `squares` (blocks, 3): sum of squared deviations from it, g^2.
    - `visit` (blocks): number of the stay in one attitude; `attitude` (visits): its attitude, as an index of `attitudes`.
    - `quantum` (3): smallest step of the readings, g; 0 if unknown.
    - `course_time_s`, `course_degc` (readings): times and temperatures of the whole recording, including movements.
    - `resolution`: of the thermometer, degC.
    """

    clock: str
    block_s: float
    size: int
    time_s: Float[np.ndarray, " blocks"]
    force: Float[np.ndarray, "blocks 3"]
    squares: Float[np.ndarray, "blocks 3"]
    visit: Int[np.ndarray, " blocks"]
    attitude: Int[np.ndarray, " visits"]
    attitudes: tuple[Attitude, ...]
    quantum: Float[np.ndarray, "3"]
    course_time_s: Float[np.ndarray, " readings"]
    course_degc: Float[np.ndarray, " readings"]
    resolution: float


@dataclass(frozen=True)
class RecordingSeries:
    """A recording over temperature, in parts between restarts of its clock.

    - `path`, `name`: of the recording, for messages and labels. `contents`: its columns, rows and damage.
    - `comments`: gravity, serial number and others. `warnings`: lines about intervals and samples that are not used.
    """

    path: Path
    name: str
    contents: Recording
    comments: Mapping[str, str]
    parts: tuple[ThermalSeries, ...]
    warnings: tuple[str, ...]

    @property
    def attitudes(self) -> tuple[Attitude, ...]:
        """The attitudes, common to all parts."""
        return self.parts[0].attitudes

    def with_attitudes(self, attitudes: tuple[Attitude, ...]) -> "RecordingSeries":
        """The same recording with these attitudes."""
        return replace(self, parts=tuple(replace(part, attitudes=attitudes) for part in self.parts))
