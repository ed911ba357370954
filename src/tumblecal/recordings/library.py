"""Recordings in Python: one call for a recording, and one for its position means."""

import shutil
import tempfile
import weakref
from pathlib import Path
from typing import Any

from tumblecal.data.positions import PositionSet
from tumblecal.recordings import reading
from tumblecal.recordings.dwells.file_names import recording_files
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.reduce import reduced


def read_recording(path: Path | str, **options: Any) -> Recording:
    """A recording of any format, with its samples in SI units and the evidence for its columns.

    **Arguments:**

    - `path`: the recording, or its description `FILE.recording.toml`.
    - `options`: fields of `RecordingOptions`, such as `unit="m/s2"` or `columns="ax=2,ay=3,az=4"`.

    **Raises:** `InputError` for a recording that cannot be read, or that does not state its columns and units.

    **Example:**

        >>> import numpy as np
        >>> import tumblecal
        >>> force = [0.01, -0.02, 1.0] + 1e-3 * np.random.default_rng(1).normal(size=(100, 3))
        >>> rows = np.column_stack([np.arange(100) / 50, force])
        >>> np.savetxt("log.csv", rows, delimiter=",", header="time_s,ax_g,ay_g,az_g", comments="")
        >>> recording = tumblecal.read_recording("log.csv")
        >>> recording.rows, round(recording.rate_hz), recording.frame().collect().columns
        (100, 50, ['time_s', 'ax_g', 'ay_g', 'az_g'])
    """
    folder = Path(tempfile.mkdtemp(prefix="tumblecal-"))
    try:
        recording = reading.read_recording(Path(path), folder / "samples.parquet", RecordingOptions(**options))
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(recording, shutil.rmtree, folder, ignore_errors=True)
    return recording


def reduce(
    *sources: Path | str,
    static: bool = False,
    plan: Path | str | None = None,
    table: Path | str | None = None,
    by: str = "",
    means: bool = False,
    run: str = "",
    mount: str = "",
    criterion: Criterion = Criterion(),
    **options: Any,
) -> PositionSet:
    """Position means of recordings of any form, as `tumblecal reduce`.

    **Arguments:**

    - `sources`: a recording or its description, the folder of a capture, or several files of one recording.
    - `static` .. `mount`: as of `KnownContext`. `options`: fields of `RecordingOptions`, such as `unit="m/s2"`.

    **Raises:** `InputError` for a recording that cannot be read, or from which no positions follow.

    **Example:**

        >>> import numpy as np
        >>> import tumblecal
        >>> force = np.repeat(np.eye(3), 50, axis=0) + 1e-3 * np.random.default_rng(1).normal(size=(150, 3))
        >>> rows = np.column_stack([np.repeat([1, 2, 3], 50), np.arange(150) / 50, force])
        >>> np.savetxt("faces.csv", rows, "%.6g", ",", header="face,time_s,ax_g,ay_g,az_g", comments="")
        >>> tumblecal.reduce("faces.csv", by="face", static=True).readings.argmax(1)
        array([0, 1, 2])
    """
    plan, table = (None if path is None else Path(path) for path in (plan, table))
    context = KnownContext(static, plan, table, by, means, run, mount)
    files = recording_files([Path(source) for source in sources], [table, plan])
    return reduced(files, context, RecordingOptions(**options), criterion).data
