"""`tumblecal reduce`: position means of samples."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tumblecal.cli.command import Command
from tumblecal.cli.options import Quiet
from tumblecal.cli.recording_options import Context, Recording, Rest, print_reduction
from tumblecal.cli.result_files import names_written, results
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


_FIGURE = "intervals.svg"
_SET = ("positions.csv", "positions.parquet", "reduction.json", _FIGURE)


def reduce(
    sources: list[Path],
    /,
    *,
    out: Path | None = None,
    context: Context = KnownContext(),
    options: Recording = RecordingOptions(),
    criterion: Rest = Criterion(),
    figures: Annotated[bool, Parameter(negative="--no-figures")] = True,
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
    from tumblecal.recordings.dwells.file_names import recording_files
    from tumblecal.recordings.dwells.rest import NothingStill
    from tumblecal.recordings.reduce import reduced
    from tumblecal.recordings.reduction import write_reduction
    from tumblecal.show.figures.drawing import write_each
    from tumblecal.show.figures.interval import FIGURES

    command, files = Command(quiet), recording_files(sources, [context.table, context.plan])
    captured = (files[0] / JOURNAL_NAME).is_file()
    folder = out or (files[0] if captured else Path("reduced"))
    try:
        with results(folder, _SET, [] if captured else [*files, context.plan, context.table]) as aside:
            found = reduced(files, context, options, criterion)
            write_reduction(found, aside)
            if figures and (stillness := found.dwells.stillness) is not None:
                write_each(aside, FIGURES, stillness, found.data.names)
    except NothingStill as nothing:
        stillness, shown = nothing.stillness, ""
        # In a folder with results of an earlier reduction it would look like a figure of these.
        if figures and stillness is not None and not any((folder / name).exists() for name in _SET[:3]):
            with results(folder, _SET) as aside:
                if write_each(aside, FIGURES, stillness):
                    shown = f"; {folder / _FIGURE} shows it"
        with guessed(getattr(nothing, "__notes__", ())):
            raise InputError(f"{nothing}{shown}") from nothing
    print_reduction(command, found)
    data = found.data
    known = f", {'attitudes unknown' if data.hand_held else 'angles known'}; standard uncertainties unknown"
    samples = known if found.noise is None else f" of {sum(map(len, found.dwells.force))} samples"
    command.say(f"{names_written(folder, _SET)}; {counted(len(data), 'position')}{samples}")
