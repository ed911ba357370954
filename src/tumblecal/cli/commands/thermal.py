"""`tumblecal thermal`: calibration over temperature from recordings."""

from pathlib import Path

from tumblecal.cli.command import Command
from tumblecal.cli.options import NoiseSd, Positive, Texts, options
from tumblecal.cli.recording_options import Context, Recording, Rest, print_recordings
from tumblecal.cli.result_files import results
from tumblecal.ground.option_texts import sd_of_reading
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


_SET = ("calibration.json", "thermal.json", "bins.csv", "parameters.csv", "thermal.html")


@options
class TemperatureOptions:
    """The dependence on temperature.

    Parameters
    ----------
    order
        Order of the polynomial of each leaf, 0 (constant) to 5. Leaves: bias, scale, orthogonality, mount. Default: chosen
        by evidence and by the prediction of rows outside the fit. Example: --order bias=3,scale=1.
    knots
        Interior knots (degC) of a cubic spline in place of a polynomial. Repeatable. Example: --knots bias=0,20,40.
    reference
        Reference temperature (degC), at which the parameters of the calibration apply. Default: that of --calibration,
        otherwise 25, if it was measured; otherwise the middle of the range. Example: --reference 20.
    bin_width
        Width of the temperature bins (degC). Default: a fortieth of the range, at least some steps of the thermometer.
        Example: --bin-width 2.
    same_attitude
        Attitudes of several files with the same direction of gravity are one attitude that did not move. Example:
        --same-attitude.
    calibration
        Calibration of the unit at one temperature, for parameters that the attitudes do not determine (one attitude
        determines only changes). Default: none. Example: --calibration unit17/calibration.json.
    """

    order: str = ""
    knots: Texts = ()
    reference: float | None = None
    bin_width: Positive | None = None
    same_attitude: bool = False
    calibration: Path | None = None


def thermal(
    recordings: list[Path],
    /,
    *,
    temperature: TemperatureOptions = TemperatureOptions(),
    context: Context = KnownContext(),
    options: Recording = RecordingOptions(),
    criterion: Rest = Criterion(),
    noise_sd: NoiseSd = None,
    out: Path = Path("thermal"),
    command: Command = Command(),
) -> int:
    """Calibrate over temperature: bias, scale factor, non-orthogonality and mount as functions of temperature.

    The samples are averaged in temperature bins. Orders are chosen by evidence and by prediction. Hysteresis, rate, lag of the
    thermometer and drift are reported; no correction includes them. Exit code: 0; 2 for input that is rejected; 3 if the
    calibration must not be used. Next: tumblecal apply, certificate or export with DIR/calibration.json.

    Parameters
    ----------
    recordings
        Recordings at still attitudes while the temperature changes (ramps, soaks, or both), of every format that reduce reads;
        position files with temperature_degc; or folders of tumblecal capture.
    out
        Output folder: calibration.json, thermal.html, thermal.json, bins.csv, parameters.csv. Example: --out unit17.
    """
    command.begin()
    from tumblecal.recordings.dwells.file_names import recording_files
    from tumblecal.recordings.thermal.read_thermal import thermal_reading
    from tumblecal.show.recordings import grouped_lines
    from tumblecal.show.thermal import print_thermal, words_of_thermal, write_thermal
    from tumblecal.thermal.result import thermal_calibration
    from tumblecal.thermal.stated import read_stated

    stated = read_stated(temperature.order, temperature.knots, temperature.reference, temperature.calibration)
    bins = {"bin_degc": temperature.bin_width, "same_attitude": temperature.same_attitude}
    sd = sd_of_reading("--noise-sd", noise_sd)
    files = recording_files(recordings, [context.table, context.plan])
    with results(out, _SET, [*files, context.plan, context.table, temperature.calibration]) as aside:
        with command.working("reading"):
            reading = thermal_reading(files, context, options, criterion, noise_sd=sd, **bins)
        lines = grouped_lines(line.partition(": ")[::2] for line in reading.lines)
        print_recordings(command, reading.read, reading.warnings, lines)
        with command.working("fitting"):
            result = thermal_calibration(reading.table, stated)
        words = words_of_thermal(result, out)
        write_thermal(aside, result, words)
    command.print_verdict(words.verdict)
    if command.words:
        print_thermal(words)
    return command.end(out, _SET, "thermal.json", result.calibration.use, reading.table.source)
