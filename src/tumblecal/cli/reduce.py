"""`tumblecal reduce`: position means of samples."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.output import Output, Quiet, warn
from tumblecal.data.overwriting import protect_inputs
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


if TYPE_CHECKING:
    from tumblecal.recordings.reduction import Reduction
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
    from tumblecal.capture.journal import JOURNAL_NAME
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.result_set import result_set
    from tumblecal.recordings.dwells.file_names import recording_files
    from tumblecal.recordings.dwells.rest import NothingStill
    from tumblecal.recordings.reduce import reduced
    from tumblecal.recordings.reduction import write_reduction

    output = Output(quiet)
    files = recording_files(sources, [context.table, context.plan])
    captured = (files[0] / JOURNAL_NAME).is_file()
    folder = out or (files[0] if captured else Path("reduced"))
    if not captured:
        protect_inputs([*files, context.plan, context.table], folders=[folder], names=_WRITTEN)
    try:
        with output_folders([folder]), result_set(folder, _WRITTEN) as aside:
            reduction = reduced(files, context, options, criterion)
            written = [path.name for path in write_reduction(reduction, aside)]
            if figures and reduction.dwells.stillness is not None:
                written += _drawn(reduction.dwells.stillness, aside, reduction.data.names)
    except NothingStill as nothing:
        # In a folder with results of an earlier reduction it would look like a figure of these.
        if not figures or nothing.stillness is None or any((folder / name).exists() for name in _WRITTEN[:3]):
            raise
        with output_folders([folder]), result_set(folder, _WRITTEN) as aside:
            shown = "".join(f"; {folder / name} shows it" for name in _drawn(nothing.stillness, aside))
        with guessed(getattr(nothing, "__notes__", ())):
            raise InputError(f"{nothing}{shown}") from nothing
    _printed(reduction, output)
    output.say(f"{', '.join(str(folder / name) for name in written)}: {_summary(reduction)}")


def _drawn(stillness: "Stillness", folder: Path, names: tuple[str, ...] = ()) -> list[str]:
    """Draw the still intervals; returns the name of the figure, if it was drawn."""
    from tumblecal.show.figures.drawing import write_each
    from tumblecal.show.figures.interval import FIGURES

    return write_each(folder, FIGURES, stillness, names)


def _printed(reduction: "Reduction", output: Output) -> None:
    """Print warnings, the recordings and the means; with --quiet only warnings."""
    from tumblecal.data.gravity_size import moving_fault, size_fault
    from tumblecal.report.recording_words import left_out_words, reduction_words
    from tumblecal.report.reduction_terminal import print_reduction, unusual_words

    data, source = reduction.data, reduction.data.source
    for name, lines in reduction.dwells.warnings:
        warn(name, lines)
    output.say("\n".join(reduction_words(reduction.dwells)))
    for recording in reduction.dwells.read:
        (warn if reduction.noise is None else output.warn)(str(recording.path), left_out_words(recording))
    if output.words and reduction.noise is not None:
        print_reduction(reduction)
    output.warn(source, unusual_words(reduction))
    if len(data) >= _FEWEST_SIZES:
        warn(source, filter(None, [size_fault(data.readings), moving_fault(data)]))


def _summary(reduction: "Reduction") -> str:
    """Number of positions, and what is known of them."""
    positions = counted(len(reduction.data), "position")
    if reduction.noise is not None:
        return f"{positions} of {sum(map(len, reduction.dwells.force))} samples"
    return f"{positions}, {'attitudes unknown' if reduction.data.hand_held else 'angles known'}; standard uncertainties unknown"
