"""Calibration over temperature in Python: one call for recordings."""

from pathlib import Path
from typing import Any

from tumblecal.recordings.options import KnownContext, RecordingOptions
from tumblecal.recordings.reduction.file_names import recording_files
from tumblecal.recordings.thermal.read_thermal import thermal_reading
from tumblecal.thermal.result import ThermalResult, thermal_calibration


def thermal(*sources: Path | str, context: KnownContext = KnownContext(), **options: Any) -> ThermalResult:
    """Calibrate over temperature from recordings at rest, as `tumblecal thermal`.

    **Arguments:**

    - `sources`: recordings, position files with temperatures, or folders of captures. `context`: known attitudes.
    - `options`: fields of `RecordingOptions`.

    **Raises:** `InputError` for recordings that cannot be read, or that do not determine a calibration.

    **Example:** `tumblecal.thermal("x_up.csv", "x_down.csv").calibration.use.words`
    """
    files = recording_files([Path(source) for source in sources], [context.table, context.plan])
    return thermal_calibration(thermal_reading(files, context, RecordingOptions(**options)).table)
