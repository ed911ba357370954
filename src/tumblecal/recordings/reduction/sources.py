"""Positions from recordings of any form: captures, tables with positions, logs at rest, several files, tables of means."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tumblecal.capture.capture_plan import read_plan
from tumblecal.capture.journal import JOURNAL_NAME
from tumblecal.data.files import read_positions
from tumblecal.data.positions import PositionSet
from tumblecal.data.raw import column_names
from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.reduction.file_positions import positions_by_names, positions_by_table
from tumblecal.recordings.reduction.reduce import reduce as reduce_capture
from tumblecal.recordings.reduction.reduce_files import reduce_files
from tumblecal.recordings.reduction.reduce_recording import means_of, reduce_recording
from tumblecal.recordings.reduction.reduce_table import reduce_table
from tumblecal.recordings.still.stillness import Stillness


# This many consecutive rows of one position are samples of a dwell.
_LIKE_SAMPLES = 16


@dataclass(frozen=True)
class Reduced:
    """Positions from recordings.

    - `data`: means; with unknown angles (`hand_held`) or known ones. `files`: read, for the provenance.
    - `read`: the recordings by source. `warnings`: for each source. `still_s`: total time at rest, None if not known.
    - `stillness`: intervals at rest, if they were searched. `lines`: how the positions of several files are known.
    """

    data: PositionSet
    files: tuple[Path, ...]
    read: tuple[tuple[str, Recording], ...] = ()
    warnings: tuple[tuple[str, list[str]], ...] = ()
    still_s: float | None = None
    stillness: Stillness | None = None
    lines: tuple[str, ...] = ()


def reduced(
    files: Sequence[Path],
    context: KnownContext = KnownContext(),
    options: RecordingOptions = RecordingOptions(),
    criterion: Criterion = Criterion(),
) -> Reduced:
    """Reduce one recording, or several files of one; attitudes that are not stated are unknown.

    **Raises:** `InputError` for a recording that cannot be read, or from which no positions follow.
    """
    if len(files) > 1 or context.table is not None:
        return _of_files(files, context, options, criterion)
    return _of_file(files[0], context, options, criterion)


def _of_files(files: Sequence[Path], context: KnownContext, options: RecordingOptions, criterion: Criterion) -> Reduced:
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
    return Reduced(table.data, tuple(files), tuple(found.read), warnings, still_s, found.stillness, lines)


def _of_file(path: Path, context: KnownContext, options: RecordingOptions, criterion: Criterion) -> Reduced:
    """The attitudes of one file or folder."""
    if path.is_dir() and (path / JOURNAL_NAME).is_file():
        table = reduce_capture(path)
        return Reduced(
            table.data, (path,), (), ((str(path), table.damage),), sum(map(len, table.dwells)) / table.rate_hz
        )
    if context.means and options == RecordingOptions(gravity=options.gravity) and _has_angles(path):
        return Reduced(read_positions(path), (path,))
    if context.means:
        data, contents = means_of(path, context, options)
        return Reduced(data, (path,), ((str(path), contents),), ((str(path), contents.damage.lines),))
    if _has_angles(path) and not context.static and context.plan is None and not context.by:
        data = read_positions(path, one_of_several=True)
        if len(data) >= _LIKE_SAMPLES * data.stretches:
            table = reduce_table(path)
            return Reduced(table.data, (path,), still_s=sum(map(len, table.dwells)) / table.rate_hz)
        return Reduced(data, (path,))
    if context.plan is None and not context.by:
        context = replace(context, static=True)
    found = reduce_recording(path, context, options, criterion)
    still_s = sum(map(len, found.table.dwells)) / found.table.rate_hz
    warnings = tuple((str(source), list(lines)) for source, lines in found.warnings)
    return Reduced(found.table.data, (path,), tuple(found.read), warnings, still_s, found.stillness)


def _has_angles(path: Path) -> bool:
    """Whether a file is a table of this program with the angles of each row."""
    if path.suffix not in (".csv", ".parquet") or not path.is_file():
        return False
    names = column_names(path)
    return "alpha_deg" in names and not {"ax_g", "ax_mg", "ax_ms2"}.isdisjoint(names)
