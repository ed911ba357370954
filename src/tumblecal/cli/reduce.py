"""`tumblecal reduce`: from samples to position means."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.capture.recordings.options import Asked, Criterion, Known
from tumblecal.cli.output import Output, Quiet, warn
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.capture.reduction import Reduction
    from tumblecal.capture.still import Stillness

_WRITTEN = ("positions.csv", "positions.parquet", "reduction.json", "intervals.svg")


def reduce(
    source: Path,
    /,
    *,
    out: Path | None = None,
    known: Annotated[Known, Parameter(name="*")] = Known(),
    asked: Annotated[Asked, Parameter(name="*")] = Asked(),
    criterion: Annotated[Criterion, Parameter(name="*")] = Criterion(),
    figures: bool = True,
    quiet: Quiet = False,
) -> None:
    """Average the samples of every position; write positions.csv, positions.parquet and reduction.json.

    The sd of each mean comes from the coloured noise, averaged over the noise models that the dwells allow; the comment
    noise_model of positions.csv holds its parts, from which calibrate and diagnose know what neighbouring positions have in
    common. Every dwell is checked: warm-up, trend, outliers, spectral lines, quantisation, saturation, losses.
    Then: tumblecal calibrate DIR/positions.csv.

    Parameters
    ----------
    source
        The folder of tumblecal capture; a table of samples with columns position, alpha_deg, beta_deg, ax_g, ay_g, az_g (or
        _mg, _ms2) and time_s; or a recording made elsewhere: text of any layout, Parquet, .mat, HDF5, ROS bag, MCAP, PX4 ULog,
        spreadsheet, byte log (tumblecal import shows what is in it).
    out
        Folder for the files; a capture's own folder, or `reduced` for anything else, where left out.
    figures
        Draw intervals.svg.
    """
    from tumblecal.ground.blas import one_thread

    if known.static and known.plan:
        raise InputError("--static says that the attitudes are unknown, --plan says which they are; give one of them")
    said = known != Known() or asked != Asked()
    output = Output(quiet)
    with one_thread():
        if source.is_dir() and not said and not (source / "metadata.yaml").exists():
            _captured(source, out or source, output)
        elif known.means:
            _means(source, known, asked, out or Path("reduced"), output)
        elif not said and _is_table(source):
            _table(source, out or Path("reduced"), output)
        else:
            _recording(source, known, asked, (criterion, figures), out or Path("reduced"), output)


def _is_table(source: Path) -> bool:
    """Whether a file has the columns of this program's own tables: then its faults are told by their own words."""
    if not source.is_file() or source.suffix not in (".csv", ".parquet"):
        return False
    from tumblecal.data.raw import column_names

    names = column_names(source)
    return not names or not {"ax_g", "ax_mg", "ax_ms2", "position"}.isdisjoint(names)


@contextmanager
def _kept(inputs: list[Path | None], folder: Path) -> Iterator[Path]:
    """Where the results are written before they take their places in a folder, all at once; none of them that of an input."""
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.result_set import result_set

    inputs_kept(inputs, folders=[folder], names=_WRITTEN)
    with output_folders([folder]), result_set(folder, _WRITTEN) as aside:
        yield aside


def _placed(folder: Path, paths: list[Path]) -> list[Path]:
    """Where files are that took their places in a folder."""
    return [folder / path.name for path in paths]


def _captured(source: Path, folder: Path, output: Output) -> None:
    """A run of tumblecal capture."""
    from tumblecal.capture.capture_plan import read_plan
    from tumblecal.capture.journal import PLAN_NAME
    from tumblecal.capture.reduce import reduce as reduced
    from tumblecal.capture.reduction import write_reduction
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.result_set import result_set
    from tumblecal.report.identity_words import identity_words

    reduction = reduced(source)
    with output_folders([folder]), result_set(folder, _WRITTEN) as aside:
        paths = _placed(folder, write_reduction(reduction, aside))
    warn(source, [*reduction.damage, *filter(None, [identity_words(reduction.data)])])
    _printed(reduction, source, output)
    _written(output, paths, f"{len(reduction.data)} of {counted(len(read_plan(source / PLAN_NAME).steps), 'position')}")


def _table(source: Path, folder: Path, output: Output) -> None:
    """A table of samples with their positions beside them."""
    from tumblecal.capture.reduce_table import reduce_table
    from tumblecal.capture.reduction import write_reduction

    with _kept([source], folder) as aside:
        table = reduce_table(source)
        paths = _placed(folder, write_reduction(table, aside))
    _reduced(table, source, paths, output)


def _means(source: Path, known: Known, asked: Asked, folder: Path, output: Output) -> None:
    """A table of means."""
    from tumblecal.capture.reduce_recording import means_of
    from tumblecal.data.files import write_positions
    from tumblecal.report.recording_words import layout_words, left_out_words

    paths = [folder / name for name in _WRITTEN[:2]]
    with _kept([source, known.plan], folder) as aside:
        data, contents = means_of(source, known, asked)
        for path in paths:
            write_positions(aside / path.name, data)
    warn(source, [*contents.damage.lines, *left_out_words(contents)])
    output.say("\n".join(layout_words(contents)))
    attitudes = "attitudes unknown" if data.hand_held else "angles known"
    _written(output, paths, f"{counted(len(data), 'position')}, {attitudes}; no sd is known")


def _recording(
    source: Path, known: Known, asked: Asked, found: tuple[Criterion, bool], folder: Path, output: Output
) -> None:
    """A recording made elsewhere."""
    from tumblecal.capture.reduce_recording import NothingStill, reduce_recording
    from tumblecal.capture.reduction import write_reduction
    from tumblecal.report.recording_words import left_out_words, reduction_words

    criterion, figures = found
    try:
        with _kept([source, known.plan], folder) as aside:
            reduction = reduce_recording(source, known, asked, criterion)
            table = reduction.table
            paths = write_reduction(table, aside, reduction.as_dict())
            if figures and reduction.stillness is not None:
                paths.append(_drawn(reduction.stillness, aside, table.data.names))
            paths = _placed(folder, paths)
    except NothingStill as nothing:
        # Beside the results of an earlier reduction it would pass for a figure of theirs.
        if not figures or nothing.stillness is None or any((folder / name).exists() for name in _WRITTEN[:3]):
            raise
        with _kept([source, known.plan], folder) as aside:
            _drawn(nothing.stillness, aside)
        raise InputError(f"{nothing}; {folder / _WRITTEN[3]} shows it") from nothing
    warn(source, reduction.contents.damage.lines)
    output.say("\n".join(reduction_words(reduction)))
    output.warn(str(source), left_out_words(reduction.contents))
    _reduced(table, source, paths, output)


def _drawn(stillness: "Stillness", folder: Path, names: tuple[str, ...] = ()) -> Path:
    from tumblecal.report.interval_figure import draw_intervals

    return draw_intervals(stillness, folder / "intervals.svg", names)


def _reduced(table: "Reduction", source: Path, paths: list[Path], output: Output) -> None:
    _printed(table, source, output)
    _written(output, paths, f"{counted(len(table.data), 'position')} of {sum(map(len, table.dwells))} samples")


def _printed(table: "Reduction", source: Path, output: Output) -> None:
    """The means; where nothing is printed, what is unusual of a position all the same."""
    from tumblecal.report.reduction_terminal import print_reduction, unusual_words

    if output.words:
        print_reduction(table)
    output.warn(str(source), unusual_words(table))


def _written(output: Output, paths: list[Path], words: str) -> None:
    output.say(f"{', '.join(str(path) for path in paths)}: {words}")
