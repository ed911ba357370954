"""The samples of positions whose means are given in a file: `diagnose --samples`."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from tumblecal.data.position_comments import ATTITUDES, UNKNOWN
from tumblecal.data.raw import read_raw
from tumblecal.ground.errors import InputError
from tumblecal.noise.within_dwells import without_common_change
from tumblecal.recordings.dwells.by_columns import labels_of_samples, sample_times
from tumblecal.recordings.dwells.dwell_samples import DwellSamples, require_samples
from tumblecal.recordings.dwells.place import Place, position_set
from tumblecal.recordings.options import KnownContext


def read_position_samples(path: Path) -> DwellSamples:
    """Read the samples of positions, without the change within dwells that all share.

    **Arguments:**

    - `path`: folder of `tumblecal capture`, or a CSV or Parquet table with columns `position`, `ax_g, ay_g, az_g` (or
      `_mg`, `_ms2`) and `time_s`; without `time_s` a comment `# rate_hz: 100` gives the sample rate. With `_ms2` a comment
      `# gravity_ms2: 9.8123` gives local gravity.

    **Raises:** `InputError` if there are no such samples, or too few.
    """
    if path.is_dir():
        from tumblecal.recordings.dwells.captured import captured_dwells

        dwells = captured_dwells(path)
    else:
        dwells = _of_table(path)
    quiet, _ = without_common_change(dwells.force, dwells.rate_hz, dwells.temperatures)
    return replace(dwells, force=quiet)


def _of_table(path: Path) -> DwellSamples:
    """All rows with the name of a position, wherever they are, are its samples."""
    raw = read_raw(path)
    if "position" not in raw.frame.columns:
        raise InputError(
            f"{path}: column position is missing; write the name of the position in the row of each sample"
        )
    label = labels_of_samples(str(path), raw.frame["position"].to_list(), "position")
    names = list(dict.fromkeys(label.tolist()))
    rows = [np.flatnonzero(label == name) for name in names]
    require_samples(str(path), names, rows, remedy="")
    rate_hz, middle_s = sample_times(raw, rows)
    force, warmth = [raw.readings[at] for at in rows], raw.temperature_degc()
    readings = np.array([dwell.mean(0) for dwell in force])
    time_s = middle_s if "time_s" in raw.frame.columns else None
    places = [Place(name) for name in names]
    data = position_set(str(path), readings, places, {ATTITUDES: UNKNOWN}, (KnownContext(), None), time_s=time_s)
    return DwellSamples(data, force, rate_hz, temperatures=None if warmth is None else [warmth[at] for at in rows])
