"""A recording of still attitudes as positions: every format that `reduce` reads, position files, and folders of captures."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tumblecal.capture.capture_plan import read_plan
from tumblecal.capture.journal import JOURNAL_NAME, sha256_of
from tumblecal.data.conditions import are_kelvin, temperature_faults
from tumblecal.data.files import read_positions
from tumblecal.data.measured import MEASURED
from tumblecal.data.positions import PositionSet
from tumblecal.data.raw import column_names
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.reduction.file_positions import positions_by_names, positions_by_table
from tumblecal.recordings.reduction.reduce import reduce
from tumblecal.recordings.reduction.reduce_files import reduce_files
from tumblecal.recordings.reduction.reduce_recording import means_of, reduce_recording
from tumblecal.recordings.reduction.reduce_table import reduce_table
from tumblecal.recordings.still.stillness import Stillness
from tumblecal.recordings.thermal.attitudes import grouped


# This many consecutive rows of one position are samples of a dwell.
_LIKE_SAMPLES = 16
# Fewer directions need a log of at least this length, s.
_FEWEST, _LONG_S = 3, 60.0


@dataclass(frozen=True)
class StillAttitudes:
    """Still attitudes.

    - `data`: means; with unknown angles (`hand_held`) or known ones. `files`: read, for the provenance.
    - `read`: contents of each recording. `warnings`: for each source. `still_s`: total time at rest, None if not known.
    - `stillness`: intervals at rest, if they were searched. `lines`: how the positions of several files are known.
    """

    data: PositionSet
    files: tuple[Path, ...]
    read: tuple[tuple[str, Recording], ...] = ()
    warnings: tuple[tuple[str, list[str]], ...] = ()
    still_s: float | None = None
    stillness: Stillness | None = None
    lines: tuple[str, ...] = ()

    @property
    def absolute(self) -> bool:
        """Whether the readings were recorded in m/s^2, or by a capture, which knows the unit of its instrument. They were then
        divided by the gravity of the recording."""
        in_ms2 = [contents.layout.unit == "ms2" for _, contents in self.read]
        return self.data.in_ms2 or any(in_ms2) or "captured_in" in self.data.comments

    def provenance(self, calibration: Path) -> dict[str, Any]:
        """Files of a check with their SHA-256, and the date of the recording, if stated."""
        measured = self.data.comments.get(MEASURED)
        return {
            "calibration": {"file": str(calibration), "sha256": sha256_of(calibration)},
            "recording": [
                {"file": str(file), "sha256": sha256_of(file) if file.is_file() else None} for file in self.files
            ],
            "measured_utc": measured,
        }

    @property
    def directions(self) -> int:
        """Number of different directions of gravity."""
        return len(grouped(self.data.readings)[1])


def still_attitudes(
    files: list[Path], context: KnownContext, options: RecordingOptions, criterion: Criterion
) -> StillAttitudes:
    """Read the still attitudes of a recording.

    **Arguments:**

    - `files`: one recording, or several files of one. Others as for `reduce`; attitudes that are not stated are unknown.

    **Raises:** `InputError` for a recording that cannot be read, has no interval at rest, or too few attitudes.
    """
    if len(files) > 1 or context.table is not None:
        found = _of_files(files, context, options, criterion)
    else:
        found = _of_file(files[0], context, options, criterion)
    data = replace(found.data, in_ms2=found.absolute)
    if context.run or context.mount:
        labels = {name: (text,) * len(data) for name in ("run", "mount") if (text := getattr(context, name))}
        data = replace(data, **labels)  # type: ignore[arg-type]
    warmth = data.temperature_degc
    if warmth is not None and are_kelvin(warmth):
        raise InputError(
            f"{data.source}: temperatures {warmth.min():.4g} to {warmth.max():.4g} are in kelvin; write degC"
        )
    for row, fault in temperature_faults(warmth) if warmth is not None else ():
        raise InputError(f"{data.source}: position {data.names[row]}: temperature {fault}")
    found = replace(found, data=data)
    if found.directions < _FEWEST and (found.still_s or 0.0) < _LONG_S:
        known = "" if found.still_s is None else f", {found.still_s:.3g} s at rest"
        raise InputError(
            f"{data.source}: only {counted(found.directions, 'attitude')}{known}; a check needs three or more attitudes, or "
            f"one log of {_LONG_S:g} s at rest"
        )
    return found


def _of_files(
    files: list[Path], context: KnownContext, options: RecordingOptions, criterion: Criterion
) -> StillAttitudes:
    plan = None if context.plan is None else read_plan(context.plan)
    if context.table is not None:
        positions = positions_by_table(files, context.table, plan)
    else:
        positions = positions_by_names(files, plan, hand_held=context.static)
    if positions.fault:
        raise InputError(positions.fault)
    found = reduce_files(positions, context, plan, options, criterion)
    table = found.table
    warnings = tuple((str(source), list(lines)) for source, lines in found.warnings)
    still_s = sum(map(len, table.dwells)) / table.rate_hz
    lines = tuple(positions.words())
    return StillAttitudes(table.data, tuple(files), tuple(found.read), warnings, still_s, found.stillness, lines)


def _of_file(path: Path, context: KnownContext, options: RecordingOptions, criterion: Criterion) -> StillAttitudes:
    """The attitudes of one file or folder."""
    if path.is_dir() and (path / JOURNAL_NAME).is_file():
        table = reduce(path)
        return StillAttitudes(
            table.data, (path,), (), ((str(path), table.damage),), sum(map(len, table.dwells)) / table.rate_hz
        )
    if context.means and options == RecordingOptions(gravity=options.gravity) and _has_angles(path):
        return StillAttitudes(read_positions(path), (path,))
    if context.means:
        data, contents = means_of(path, context, options)
        return StillAttitudes(data, (path,), ((str(path), contents),), ((str(path), contents.damage.lines),))
    if _has_angles(path) and not context.static and context.plan is None and not context.by:
        data = read_positions(path, one_of_several=True)
        if len(data) >= _LIKE_SAMPLES * data.stretches:
            table = reduce_table(path)
            return StillAttitudes(table.data, (path,), still_s=sum(map(len, table.dwells)) / table.rate_hz)
        return StillAttitudes(data, (path,))
    if context.plan is None and not context.by:
        context = replace(context, static=True)
    found = reduce_recording(path, context, options, criterion)
    still_s = sum(map(len, found.table.dwells)) / found.table.rate_hz
    warnings = tuple((str(source), list(lines)) for source, lines in found.warnings)
    return StillAttitudes(found.table.data, (path,), tuple(found.read), warnings, still_s, found.stillness)


def _has_angles(path: Path) -> bool:
    """Whether a file is a table of this program with the angles of each row."""
    if path.suffix not in (".csv", ".parquet") or not path.is_file():
        return False
    names = column_names(path)
    return "alpha_deg" in names and not {"ax_g", "ax_mg", "ax_ms2"}.isdisjoint(names)
