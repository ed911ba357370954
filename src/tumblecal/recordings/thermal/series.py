"""A recording over temperature in blocks: time, accelerations, temperature, and the position of each."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from tumblecal.recordings.dwells.place import Place
from tumblecal.recordings.recording import Recording


@dataclass(frozen=True)
class ThermalSeries:
    """The blocks at rest of one recording, or of its part between two restarts of the clock.

    - `name`: of the recording in labels; `clock`: that of its clock. `recording`: its columns, rows and damage.
    - `comments`: gravity, serial number and others.
    - `block_s`: length of a block, s; `size`: its samples.
    - `time_s` (blocks): middle, s. `force` (blocks, 3): mean, g. `squares` (blocks, 3): sum of squared deviations from it, g^2.
    - `visit` (blocks): number of the stay in one attitude; `attitude` (visits): its attitude, as an index of `places`, which
      are common to all parts of a recording.
    - `quantum` (3): smallest step of the readings, g; 0 if unknown.
    - `course_time_s`, `course_degc` (readings): times and temperatures of the whole recording, including movements.
    - `resolution`: of the thermometer, degC.
    """

    name: str
    clock: str
    recording: Recording
    comments: Mapping[str, str]
    block_s: float
    size: int
    time_s: Float[np.ndarray, " blocks"]
    force: Float[np.ndarray, "blocks 3"]
    squares: Float[np.ndarray, "blocks 3"]
    visit: Int[np.ndarray, " blocks"]
    attitude: Int[np.ndarray, " visits"]
    places: tuple[Place, ...]
    quantum: Float[np.ndarray, "3"]
    course_time_s: Float[np.ndarray, " readings"]
    course_degc: Float[np.ndarray, " readings"]
    resolution: float
