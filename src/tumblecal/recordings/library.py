"""Recordings in Python: one call for a recording, and one for its position means."""

import shutil
import tempfile
import weakref
from pathlib import Path
from typing import Any

from tumblecal.data.positions import PositionSet
from tumblecal.recordings import reading
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.reduction.file_names import recording_files
from tumblecal.recordings.reduction.sources import reduced


def read_recording(path: Path | str, **options: Any) -> Recording:
    """A recording of any format, with its samples in SI units and the evidence for its columns.

    **Arguments:**

    - `path`: the recording, or its description `FILE.recording.toml`.
    - `options`: fields of `RecordingOptions`, such as `unit="m/s2"` or `columns="ax=2,ay=3,az=4"`.

    **Raises:** `InputError` for a recording that cannot be read, or that does not state its columns and units.

    **Example:** `tumblecal.read_recording("log.csv").frame().collect()`
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

    **Example:** `tumblecal.calibrate(tumblecal.reduce("log.csv", static=True))`
    """
    plan, table = (None if path is None else Path(path) for path in (plan, table))
    context = KnownContext(static, plan, table, by, means, run, mount)
    files = recording_files([Path(source) for source in sources], [table, plan])
    return reduced(files, context, RecordingOptions(**options), criterion).data
