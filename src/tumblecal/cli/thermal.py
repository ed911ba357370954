"""`tumblecal thermal`: calibration over temperature from recordings."""

from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.command import Command, results
from tumblecal.cli.options import NoiseSd, Positive, Texts, options
from tumblecal.cli.recording_options import Context, Recording, Rest
from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


if TYPE_CHECKING:
    from tumblecal.thermal.choice import Stated

_SET = ("calibration.json", "thermal.json", "bins.csv", "parameters.csv", "thermal.html")
# Names of leaves in options, and in the model.
_LEAVES = {"bias": "bias", "scale": "dK", "orthogonality": "gamma", "mount": "dtheta"}


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

    def stated(self) -> "Stated":
        """What the options state.

        **Raises:** `InputError` for an option that cannot be read.
        """
        from tumblecal.data.calibration import read_calibration
        from tumblecal.ground.option_texts import numbers, pairs
        from tumblecal.ground.temperature_functions import HIGHEST_ORDER
        from tumblecal.thermal.choice import Stated

        orders = pairs("--order", self.order, "bias=3,scale=1", _LEAVES)
        knots = pairs("--knots", self.knots, "bias=0,20,40", _LEAVES)
        if both := [leaf for leaf in knots if leaf in orders]:
            raise InputError(f"--order and --knots both state {both[0]}; give one of them")
        if wrong := {*orders.values()} - {*map(str, range(HIGHEST_ORDER + 1))}:
            raise InputError(f"--order {self.order}: {min(wrong)!r} is not an order from 0 to {HIGHEST_ORDER}")
        base = None if self.calibration is None else read_calibration(self.calibration)
        if base is not None and self.calibration is not None:
            base.use.require(self.calibration, anyway=False)
        return Stated(
            {_LEAVES[leaf]: int(order) for leaf, order in orders.items()},
            {_LEAVES[leaf]: numbers(f"--knots {leaf}", text, "0,20,40") for leaf, text in knots.items()},
            self.reference,
            base,
        )


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
    from rich.console import Console

    from tumblecal.ground.option_texts import sd_of_reading
    from tumblecal.recordings.dwells.file_names import recording_files
    from tumblecal.recordings.thermal.read_thermal import thermal_reading
    from tumblecal.show.figures.thermal import FIGURES
    from tumblecal.show.narrow import print_table
    from tumblecal.show.page import write_page
    from tumblecal.show.recordings import grouped_lines
    from tumblecal.show.thermal import temperature_table, words_of_thermal
    from tumblecal.show.verdict import verdict_lines
    from tumblecal.thermal.record import write_thermal
    from tumblecal.thermal.result import thermal_calibration

    stated, sd = temperature.stated(), sd_of_reading("--noise-sd", noise_sd)
    files = recording_files(recordings, [context.table, context.plan])
    with results(out, _SET, [*files, context.plan, context.table, temperature.calibration]) as aside:
        with command.working("reading"):
            width, same = temperature.bin_width, temperature.same_attitude
            reading = thermal_reading(
                files, context, options, criterion, bin_degc=width, same_attitude=same, noise_sd=sd
            )
        command.print_recordings(
            reading.read, reading.warnings, grouped_lines(line.partition(": ")[::2] for line in reading.lines)
        )
        with command.working("fitting"):
            result = thermal_calibration(reading.table, stated)
        words = words_of_thermal(result, out)
        write_thermal(aside, result, words.verdict.words().splitlines())
        tables = {} if result.curves is None else {"temperature": temperature_table(result)}
        write_page(aside / "thermal.html", words, FIGURES, result, tables=tables)
    command.say("", *verdict_lines(words.verdict, command.columns))
    for name in ("reference", "coefficients") if command.words else ():
        if table := words.table(name):
            print()
            print_table(Console(), table)
    return command.end(out, _SET, "thermal.json", result.calibration.use, reading.table.source)
