"""`tumblecal reduce`: position means of samples."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.output import Output, Quiet, warn
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


if TYPE_CHECKING:
    from tumblecal.data import PositionSet
    from tumblecal.recordings.reduction.reduce_files import FilesReduction
    from tumblecal.recordings.reduction.reduce_recording import RecordingReduction
    from tumblecal.recordings.reduction.reduction import Reduction
    from tumblecal.recordings.still.stillness import Stillness

# With fewer attitudes a bias may change the median size of the readings.
_FEWEST_SIZES = 6
_WRITTEN = ("positions.csv", "positions.parquet", "reduction.json", "intervals.svg")


def reduce(
    sources: list[Path],
    /,
    *,
    out: Path | None = None,
    context: Annotated[KnownContext, Parameter(name="*")] = KnownContext(),
    options: Annotated[RecordingOptions, Parameter(name="*")] = RecordingOptions(),
    criterion: Annotated[Criterion, Parameter(name="*")] = Criterion(),
    figures: bool = True,
    quiet: Quiet = False,
) -> None:
    """Average the samples of every position; write positions.csv, positions.parquet and reduction.json.

    The standard uncertainty of each mean includes coloured noise, averaged over the noise models that fit the dwells. The
    comment noise_model of positions.csv has its parts, from which calibrate and diagnose compute the correlation of
    neighbouring positions. Every dwell is checked for warm-up, trend, outliers, spectral lines, quantisation, saturation and
    losses. Next: tumblecal calibrate DIR/positions.csv.

    Parameters
    ----------
    sources
        Folder of tumblecal capture; table of samples with columns position, alpha_deg, beta_deg, ax_g, ay_g, az_g (or _mg,
        _ms2) and time_s; or another recording: text of any layout, Parquet, .mat, HDF5, ROS bag, MCAP, PX4 ULog, DataFlash,
        Xsens .mtb, spreadsheet, byte log (tumblecal import describes it). Several files, a folder of files or a pattern are
        one recording with one file for each position. Their positions are those of --table, those of --plan with the names of
        the files or in the direction of gravity, or unknown.
    out
        Output folder. Default: the folder of a capture, otherwise `reduced`. Example: --out reduced17.
    figures
        Figure intervals.svg of the still intervals. Example: --no-figures.
    """
    from tumblecal.ground.blas import single_blas_thread
    from tumblecal.recordings.reduction.file_names import recording_files

    if context.static and context.plan:
        raise InputError(
            "--static states that the attitudes are unknown, --plan states them; give only one of these options"
        )
    described = context != KnownContext() or options != RecordingOptions()
    output = Output(quiet)
    files = recording_files(sources, [context.table, context.plan])
    with single_blas_thread():
        if len(files) > 1 or context.table is not None:
            _files(files, context, options, (criterion, figures), out or Path("reduced"), output)
            return
        (source,) = files
        if source.is_dir() and not described and not (source / "metadata.yaml").exists():
            _captured(source, out or source, output)
        elif context.means:
            _means(source, context, options, out or Path("reduced"), output)
        elif not described and _is_table(source):
            _table(source, out or Path("reduced"), output)
        else:
            _recording(source, context, options, (criterion, figures), out or Path("reduced"), output)


def _is_table(source: Path) -> bool:
    """Whether a file has the columns of a table of this program, so that its faults are named by these columns."""
    if not source.is_file() or source.suffix not in (".csv", ".parquet"):
        return False
    from tumblecal.data.raw import column_names

    names = column_names(source)
    return not names or not {"ax_g", "ax_mg", "ax_ms2", "position"}.isdisjoint(names)


@contextmanager
def _results_folder(inputs: list[Path | None], folder: Path) -> Iterator[Path]:
    """Temporary folder of the results, which are moved to `folder` all at once; no input is overwritten."""
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.result_set import result_set

    protect_inputs(inputs, folders=[folder], names=_WRITTEN)
    with output_folders([folder]), result_set(folder, _WRITTEN) as aside:
        yield aside


def _moved(folder: Path, paths: list[Path]) -> list[Path]:
    """The paths of files after their move to a folder."""
    return [folder / path.name for path in paths]


def _captured(source: Path, folder: Path, output: Output) -> None:
    """A run of tumblecal capture."""
    from tumblecal.capture.journal import read_journal, replayed
    from tumblecal.capture.run.run_folder import plan_of_run
    from tumblecal.data.position_comments import identity_words
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.result_set import result_set
    from tumblecal.recordings.reduction.reduce import reduce as reduced
    from tumblecal.recordings.reduction.reduction import write_reduction

    reduction = reduced(source)
    with output_folders([folder]), result_set(folder, _WRITTEN) as aside:
        paths = _moved(folder, write_reduction(reduction, aside))
    warn(source, [*reduction.damage, *filter(None, [identity_words(reduction.data)])])
    _printed(reduction, source, output)
    total = len(plan_of_run(source, replayed(read_journal(source))).steps)
    _written(output, paths, f"{len(reduction.data)} of {counted(total, 'position')}")


def _table(source: Path, folder: Path, output: Output) -> None:
    """A table of samples with a column for their positions."""
    from tumblecal.recordings.reduction.reduce_table import reduce_table
    from tumblecal.recordings.reduction.reduction import write_reduction

    with _results_folder([source], folder) as aside:
        table = reduce_table(source)
        paths = _moved(folder, write_reduction(table, aside))
    _reduced(table, source, paths, output)


def _means(source: Path, context: KnownContext, options: RecordingOptions, folder: Path, output: Output) -> None:
    """A table of means."""
    from tumblecal.data.files import write_positions
    from tumblecal.recordings.reduction.reduce_recording import means_of
    from tumblecal.report.recording_words import layout_words, left_out_words

    paths = [folder / name for name in _WRITTEN[:2]]
    with _results_folder([source, context.plan], folder) as aside:
        data, contents = means_of(source, context, options)
        for path in paths:
            write_positions(aside / path.name, data)
    warn(source, [*contents.damage.lines, *left_out_words(contents)])
    _sizes_checked(source, data)
    output.say("\n".join(layout_words(contents)))
    attitudes = "attitudes unknown" if data.hand_held else "angles known"
    _written(output, paths, f"{counted(len(data), 'position')}, {attitudes}; standard uncertainties unknown")


def _files(
    files: list[Path],
    context: KnownContext,
    options: RecordingOptions,
    found: tuple[Criterion, bool],
    folder: Path,
    output: Output,
) -> None:
    """Several files of one recording. Their positions, which may be guesses, are printed before any fault."""
    from tumblecal.capture.capture_plan import read_plan
    from tumblecal.recordings.reduction.file_positions import (
        FilePosition,
        FilePositions,
        positions_by_names,
        positions_by_table,
    )
    from tumblecal.recordings.reduction.reduce_files import reduce_files
    from tumblecal.report.recording_words import files_words

    if context.means:
        raise InputError(
            f"{files[0]}: --means needs one table with one row for each position, but {len(files)} files are given"
        )
    plan = None if context.plan is None else read_plan(context.plan)
    if context.table is not None:
        positions = positions_by_table(files, context.table, plan)
    elif context.by:
        positions = FilePositions(tuple(FilePosition(file, file.stem) for file in files), "")
    else:
        positions = positions_by_names(files, plan, hand_held=context.static)
    output.say("\n".join(positions.words()))
    if positions.fault:
        raise InputError(positions.fault)
    inputs = [*files, context.plan, context.table]
    _still_reduction(
        (lambda: reduce_files(positions, context, plan, options, found[0])),
        files_words,
        inputs,
        found[1],
        folder,
        output,
    )


def _recording(
    source: Path,
    context: KnownContext,
    options: RecordingOptions,
    found: tuple[Criterion, bool],
    folder: Path,
    output: Output,
) -> None:
    """A recording of another program."""
    from tumblecal.recordings.reduction.reduce_recording import reduce_recording
    from tumblecal.report.recording_words import reduction_words

    inputs = [source, context.plan]
    _still_reduction(
        (lambda: reduce_recording(source, context, options, found[0])),
        reduction_words,
        inputs,
        found[1],
        folder,
        output,
    )


def _still_reduction(
    reduced: "Callable[[], RecordingReduction | FilesReduction]",
    words: Callable[..., Iterable[str]],
    inputs: list[Path | None],
    figures: bool,
    folder: Path,
    output: Output,
) -> None:
    """Write a reduction by still intervals, and print its `words`; if no interval is still, only the figure."""
    from tumblecal.recordings.reduction.means_at_rest import NothingStill
    from tumblecal.recordings.reduction.reduction import write_reduction
    from tumblecal.report.recording_words import left_out_words

    try:
        with _results_folder(inputs, folder) as aside:
            reduction = reduced()
            table = reduction.table
            paths = write_reduction(table, aside, reduction.as_dict())
            if figures and reduction.stillness is not None:
                paths += _drawn(reduction.stillness, aside, table.data.names)
            paths = _moved(folder, paths)
    except NothingStill as nothing:
        # In a folder with results of an earlier reduction it would look like a figure of these.
        if not figures or nothing.stillness is None or any((folder / name).exists() for name in _WRITTEN[:3]):
            raise
        with _results_folder(inputs, folder) as aside:
            shown = "".join(f"; {folder / path.name} shows it" for path in _drawn(nothing.stillness, aside))
        with guessed(getattr(nothing, "__notes__", ())):
            raise InputError(f"{nothing}{shown}") from nothing
    for source, lines in reduction.warnings:
        warn(source, lines)
    output.say("\n".join(words(reduction)))
    for source, contents in reduction.read:
        output.warn(str(source), left_out_words(contents))
    _reduced(table, Path(table.data.source), paths, output)


def _drawn(stillness: "Stillness", folder: Path, names: tuple[str, ...] = ()) -> list[Path]:
    """Draw the still intervals; returns the path of the figure, if it was drawn."""
    from tumblecal.report.drawing import draw_each, save
    from tumblecal.report.interval_figure import interval_figure

    return [*draw_each(folder, {"intervals.svg": lambda: interval_figure(stillness, names)}, save).values()]


def _reduced(table: "Reduction", source: Path, paths: list[Path], output: Output) -> None:
    _printed(table, source, output)
    _written(output, paths, f"{counted(len(table.data), 'position')} of {sum(map(len, table.dwells))} samples")


def _printed(table: "Reduction", source: Path, output: Output) -> None:
    """Print the means; with --quiet only warnings on unusual positions."""
    from tumblecal.report.reduction_terminal import print_reduction, unusual_words

    if output.words:
        print_reduction(table)
    output.warn(str(source), unusual_words(table))
    _sizes_checked(source, table.data)


def _sizes_checked(source: Path, data: "PositionSet") -> None:
    """Warnings on a wrong size of the means."""
    from tumblecal.data.gravity_size import moving_fault, size_fault

    if len(data) >= _FEWEST_SIZES:
        warn(source, filter(None, [size_fault(data.readings), moving_fault(data)]))


def _written(output: Output, paths: list[Path], words: str) -> None:
    output.say(f"{', '.join(str(path) for path in paths)}: {words}")
