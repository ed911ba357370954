"""`tumblecal reduce`: from samples to position means."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.capture.recordings.table import Asked
from tumblecal.capture.still import Criterion
from tumblecal.cli.options import LocalGravity
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.capture.reduce_recording import Known
    from tumblecal.capture.still import Stillness

_WRITTEN = ("positions.csv", "positions.parquet", "reduction.json", "intervals.svg")


def reduce(
    source: Path,
    /,
    *,
    out: Path | None = None,
    static: Annotated[bool, Parameter(negative=())] = False,
    plan: Path | None = None,
    by: str = "",
    means: Annotated[bool, Parameter(negative=())] = False,
    gravity: LocalGravity = None,
    run: str = "",
    mount: str = "",
    figures: bool = True,
    asked: Annotated[Asked, Parameter(name="*")] = Asked(),
    criterion: Annotated[Criterion, Parameter(name="*")] = Criterion(),
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
    static
        Find the still intervals; their attitudes are unknown (a hand-held set). intervals.svg shows them over the signal.
    plan
        Find the still intervals of this plan (TOML, as of tumblecal capture), in its order or in any.
    by
        Column of the recording that names the position of each sample.
    means
        Each row is the mean of a position already.
    run
        Label of the run, a column of positions.csv.
    mount
        Label of the mounting.
    figures
        Draw intervals.svg.
    """
    from tumblecal.capture.reduce_recording import Known
    from tumblecal.ground.gravity import gravity_of_option

    if static and plan:
        raise InputError("--static says that the attitudes are unknown, --plan says which they are; give one of them")
    known = Known(plan, static, by, gravity_of_option(gravity) if gravity else None, run, mount)
    said = known != Known() or asked != Asked() or means
    if source.is_dir() and (source / "journal.log").exists():
        if said:
            raise InputError(f"{source}: a captured folder says all of itself; leave the options of recordings out")
        _captured(source, out)
    elif means:
        _means(source, known, asked, out or Path("reduced"))
    elif not said and _is_table(source):
        _table(source, out or Path("reduced"))
    else:
        _recording(source, known, asked, (criterion, figures), out or Path("reduced"))


def _is_table(source: Path) -> bool:
    """Whether a file has the columns of this program's own tables: then its faults are told by their own words."""
    if not source.is_file() or source.suffix not in (".csv", ".parquet"):
        return False
    if source.suffix == ".parquet":
        from tumblecal.data.parquet import scan_parquet

        return any(name.startswith("ax_") for name in scan_parquet(source)[0].collect_schema().names())
    with source.open("rb") as file:
        lines = file.read(1 << 16).decode("utf-8-sig", "replace").splitlines()
    header = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    return not header or any(name in header for name in ("ax_g", "ax_mg", "ax_ms2", "position"))


def _captured(source: Path, out: Path | None) -> None:
    """A run of tumblecal capture."""
    from tumblecal.capture.reduce import position_set, write_reduction
    from tumblecal.capture.reduce import reduce as reduced
    from tumblecal.ground.atomic import output_folders
    from tumblecal.report.reduction_terminal import print_reduction

    r, folder = reduced(source), out or source
    with output_folders([folder]):
        paths = write_reduction(r, source, folder)
    dwells = [position.force for position in r.positions]
    print_reduction(position_set(r, source), dwells, r.checks, (r.recorded, r.rate_hz))
    _written(paths, f"{len(r.positions)} of {len(r.plan.steps)} positions")


def _table(source: Path, folder: Path) -> None:
    """A table of samples with their positions beside them."""
    from tumblecal.capture.reduce_table import reduce_table, write_table_reduction
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.ground.atomic import output_folders
    from tumblecal.report.reduction_terminal import print_reduction

    inputs_kept([source], folders=[folder], names=_WRITTEN)
    with output_folders([folder]):
        table = reduce_table(source)
        paths = write_table_reduction(table, folder)
    print_reduction(table.data, table.dwells, table.checks, (table.recorded, table.rate_hz))
    _written(paths, f"{len(table.data)} positions of {sum(map(len, table.dwells))} samples")


def _means(source: Path, known: "Known", asked: Asked, folder: Path) -> None:
    """A table of means."""
    from tumblecal.capture.reduce_recording import means_of
    from tumblecal.data.files import write_positions
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.ground.atomic import output_folders

    paths = [folder / name for name in _WRITTEN[:2]]
    inputs_kept([source], folders=[folder], names=_WRITTEN)
    with output_folders([folder]):
        data = means_of(source, known, asked)
        for path in paths:
            write_positions(path, data)
    _written(
        paths, f"{len(data)} positions, {'attitudes unknown' if data.hand_held else 'angles known'}; no sd is known"
    )


def _recording(source: Path, known: "Known", asked: Asked, found: tuple[Criterion, bool], folder: Path) -> None:
    """A recording made elsewhere."""
    from tumblecal.capture.reduce_recording import NothingStill, reduce_recording
    from tumblecal.capture.reduce_table import write_table_reduction
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.ground.atomic import output_folders
    from tumblecal.report.recording_words import reduction_words
    from tumblecal.report.reduction_terminal import print_reduction

    criterion, figures = found
    inputs_kept([source, known.plan], folders=[folder], names=_WRITTEN)
    with output_folders([folder]):
        try:
            reduction = reduce_recording(source, known, asked, criterion)
        except NothingStill as nothing:
            if figures and nothing.stillness is not None:
                raise InputError(f"{nothing}; {_drawn(nothing.stillness, folder)} shows it") from nothing
            raise
        table = reduction.table
        paths = write_table_reduction(table, folder, reduction.as_dict())
        if figures and reduction.stillness is not None:
            paths.append(_drawn(reduction.stillness, folder, table.data.names))
    for line in reduction_words(reduction):
        print(line)
    print_reduction(table.data, table.dwells, table.checks, (table.recorded, table.rate_hz))
    _written(paths, f"{len(table.data)} positions of {sum(map(len, table.dwells))} samples")


def _drawn(stillness: "Stillness", folder: Path, names: tuple[str, ...] = ()) -> Path:
    from tumblecal.report.interval_figure import draw_intervals

    return draw_intervals(stillness, folder / "intervals.svg", names)


def _written(paths: list[Path], words: str) -> None:
    print(f"{', '.join(str(path) for path in paths)}: {words}")
