"""The samples of positions whose means are given in a file: `diagnose --samples`."""

from dataclasses import replace
from pathlib import Path

from tumblecal.data.raw import read_raw
from tumblecal.noise.within_dwells import without_common_change
from tumblecal.recordings.dwells.by_columns import dwells_by_columns
from tumblecal.recordings.dwells.dwell_samples import DwellSamples


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
        dwells = dwells_by_columns(read_raw(path), "", means_given=True)
    quiet, _ = without_common_change(dwells.force, dwells.rate_hz, dwells.temperatures)
    return replace(dwells, force=quiet)
