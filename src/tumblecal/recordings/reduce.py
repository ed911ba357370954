"""Positions from recordings of any form: captures, tables with positions, logs at rest, several files, tables of means."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tumblecal.capture.capture_plan import read_plan
from tumblecal.capture.journal import JOURNAL_NAME, sha256_of
from tumblecal.data.files import read_positions
from tumblecal.data.parquet import scan_parquet
from tumblecal.data.positions import PositionSet
from tumblecal.data.raw import read_raw
from tumblecal.ground.atomic import scratch_folder
from tumblecal.ground.errors import InputError
from tumblecal.ground.precision import single_blas_thread
from tumblecal.recordings.dwells.by_columns import dwells_by_columns, means_of, table_with_plan
from tumblecal.recordings.dwells.dwell_samples import DwellSamples
from tumblecal.recordings.dwells.join import joined, notes_of
from tumblecal.recordings.dwells.places import FilePlaces, Known, places_by_names, places_by_table
from tumblecal.recordings.dwells.rest import dwells_at_rest
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.own_tables import are_samples, own_columns
from tumblecal.recordings.reduction import Reduction, reduction_of


_QUESTION = (
    "state how to find its positions: --static finds intervals at rest with unknown attitudes (hand-held), --plan PLAN.toml "
    "those of a plan, --by COLUMN goes by a column; --means takes each row for a mean"
)


def reduced(
    files: Sequence[Path],
    context: KnownContext = KnownContext(),
    options: RecordingOptions = RecordingOptions(),
    criterion: Criterion = Criterion(),
) -> Reduction:
    """Reduce one recording, or several files of one.

    **Arguments:**

    - `files`: the folder of a capture, a table of samples with positions, or recordings of any format.
    - `context`: positions, run and mounting. `options`: columns and units. `criterion`: for an interval at rest.

    **Raises:** `InputError` for a recording that cannot be read, or from which no positions follow; `NothingStill` without an
    interval at rest.

    **Example:** `reduced([Path("log.csv")], KnownContext(static=True)).data.readings`
    """
    with single_blas_thread():
        return reduction_of(replace(_dwells_of(files, context, options, criterion), files=tuple(files)))


def positions_or_rest(
    files: Sequence[Path], context: KnownContext, options: RecordingOptions, criterion: Criterion
) -> Reduction:
    """The positions of a file of this program as they are; otherwise as `reduced`, at rest with unknown attitudes if nothing
    states how to find the positions.

    **Raises:** as `reduced`.
    """
    path, named = files[0], context.plan or context.by or context.table
    if len(files) == 1 and not (context.static or named) and (data := position_file(path, context, options)):
        return Reduction(data, DwellSamples(data, files=(path,)))
    unstated = not (named or context.means or (path / JOURNAL_NAME).is_file())
    return reduced(files, replace(context, static=context.static or unstated, run="", mount=""), options, criterion)


def position_file(path: Path, context: KnownContext, options: RecordingOptions) -> PositionSet | None:
    """The positions of a table with angles; None for other files, and for tables of samples."""
    if "alpha_deg" not in own_columns(path) or (context.means and options != RecordingOptions(gravity=options.gravity)):
        return None
    data = read_positions(path, one_of_several=not context.means)
    return data if context.means or not are_samples(data) else None


def _dwells_of(
    files: Sequence[Path], context: KnownContext, options: RecordingOptions, criterion: Criterion
) -> DwellSamples:
    """The dwells of one recording, or several files of one.

    **Arguments, raises:** as `reduced`.
    """
    if context.static and context.plan:
        raise InputError(
            "--static states that the attitudes are unknown, --plan states them; give only one of these options"
        )
    known = context, plan = context, None if context.plan is None else read_plan(context.plan)
    path, usual, places = files[0], options == RecordingOptions(), None
    if len(files) > 1 or context.table is not None:
        if context.means:
            raise InputError(
                f"{path}: --means needs one table with one row for each position, but {len(files)} files are given"
            )
        if context.table is not None:
            places = places_by_table(files, context.table, plan)
        else:
            places = places_by_names(files, plan, hand_held=context.static or bool(context.by))
            places = replace(places, by="") if context.by else places
    elif usual and (path / JOURNAL_NAME).is_file() and context == KnownContext(run=context.run, mount=context.mount):
        from tumblecal.recordings.dwells.captured import captured_dwells  # imports the protocols

        return captured_dwells(path, context)
    elif context.means:
        return means_of(path, known, options)
    elif usual and context == KnownContext() and own_columns(path):
        return dwells_by_columns(read_raw(path), sha256_of(path)[:16])
    with guessed(places.words() if places else ()), scratch_folder(path) as folder:
        return _of_recordings(files, folder, places, known, options, criterion)


def _of_recordings(
    files: Sequence[Path],
    folder: Path,
    places: FilePlaces | None,
    known: Known,
    options: RecordingOptions,
    criterion: Criterion,
) -> DwellSamples:
    """The dwells of files as one recording: by a column, otherwise by rest; `folder`: for its samples."""
    context, plan = known
    table = joined(files, folder, options, context.by)
    recordings = table.recordings
    in_order = places and replace(places, places=tuple(places.places[k] for k in table.order))
    with guessed(notes_of(recordings)):
        named = {"position", "alpha_deg"} & {*scan_parquet(table.samples, check=False)[0].collect_schema()}
        if context.by or (named and not (context.static or plan or context.table)):
            found = dwells_by_columns(table_with_plan(table.samples, table.source, known), table.identifier)
        elif plan is None and not context.static and places is None:
            raise InputError(f"{table.source}: {_QUESTION}")
        else:
            found = dwells_at_rest(table, in_order, known, criterion)
    data, clocks = table.with_clocks(found.positions)
    entries, lines = recordings[0].entries, found.lines
    if places is not None and in_order is not None:
        rows = [
            {"file": str(one.path), "position": place.position, "rows": one.rows, "starts_at_s": base} | one.entries
            for one, base, place in zip(recordings, table.bases_s, in_order.places, strict=True)
        ]
        entries, lines = {"files": rows, "clocks": clocks}, (*places.words(), *lines)
    return replace(
        found,
        positions=data,
        time_s=found.positions.time_s,
        entries=entries | dict(found.entries),
        read=recordings,
        warnings=(*((str(one.path), one.damage.lines) for one in recordings), *found.warnings),
        lines=(*lines, *filter(None, [clocks])),
    )
