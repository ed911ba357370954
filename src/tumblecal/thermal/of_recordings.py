"""Calibration over temperature in Python: one call for recordings."""

from pathlib import Path
from typing import Any

from tumblecal.recordings.dwells.file_names import recording_files
from tumblecal.recordings.options import KnownContext, RecordingOptions
from tumblecal.recordings.thermal.read_thermal import thermal_reading
from tumblecal.thermal.result import ThermalResult, thermal_calibration


def thermal(*sources: Path | str, context: KnownContext = KnownContext(), **options: Any) -> ThermalResult:
    """Calibrate over temperature from recordings at rest, as `tumblecal thermal`.

    **Arguments:**

    - `sources`: recordings, position files with temperatures, or folders of captures. `context`: known attitudes.
    - `options`: fields of `RecordingOptions`.

    **Raises:** `InputError` for recordings that cannot be read, or that do not determine a calibration.

    **Example:**

        >>> import numpy as np
        >>> import tumblecal
        >>> degc = np.linspace(20, 40, 2000)
        >>> for name, sign in (("up.csv", 1), ("down.csv", -1)):
        ...     noise = 1e-4 * np.random.default_rng(1).normal(size=(2000, 3))
        ...     force = sign * np.array([0, 0, 1.0]) + 1e-4 * (degc[:, None] - 30) + noise
        ...     rows = np.column_stack([np.arange(2000) / 10, force, degc])
        ...     np.savetxt(name, rows, "%.6f", ",", header="time_s,ax_g,ay_g,az_g,temperature_degc", comments="")
        >>> tumblecal.thermal_calibration("up.csv", "down.csv").calibration.temperature.reference_degc
        25.0
    """
    files = recording_files([Path(source) for source in sources], [context.table, context.plan])
    return thermal_calibration(thermal_reading(files, context, RecordingOptions(**options)).table)
