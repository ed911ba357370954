"""`tumblecal thermal`: calibration over temperature from recordings."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.calibrate import NOT_USABLE
from tumblecal.cli.options import NoiseSd
from tumblecal.cli.output import Output, warn
from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


if TYPE_CHECKING:
    from tumblecal.recordings.thermal.read_thermal import ThermalReading
    from tumblecal.thermal.choice import Stated

_WRITTEN = ("calibration.json", "thermal.json", "bins.csv", "parameters.csv", "thermal.html")
# Names of leaves in options, and in the model.
_LEAVES = {"bias": "bias", "scale": "dK", "orthogonality": "gamma", "mount": "dtheta"}


@Parameter(name="*")
@dataclass(frozen=True)
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
    knots: tuple[str, ...] = ()
    reference: float | None = None
    bin_width: float | None = None
    same_attitude: Annotated[bool, Parameter(negative=())] = False
    calibration: Path | None = None


def thermal(
    recordings: list[Path],
    /,
    *,
    temperature: TemperatureOptions = TemperatureOptions(),
    context: Annotated[KnownContext, Parameter(name="*")] = KnownContext(),
    options: Annotated[RecordingOptions, Parameter(name="*")] = RecordingOptions(),
    criterion: Annotated[Criterion, Parameter(name="*")] = Criterion(),
    noise_sd: NoiseSd = None,
    out: Path = Path("thermal"),
    output: Output = Output(),
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
    from rich.console import Console

    from tumblecal.cli.start import start

    output.begin()
    start()
    from tumblecal.cli.model_options import stated_noise_sd
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.blas import single_blas_thread
    from tumblecal.ground.result_set import result_set
    from tumblecal.recordings.dwells.file_names import recording_files
    from tumblecal.recordings.thermal.read_thermal import thermal_reading
    from tumblecal.show.narrow import print_table
    from tumblecal.show.thermal import value_tables, verdict_of_thermal, words_of_thermal, write_thermal_page
    from tumblecal.show.verdict import verdict_lines
    from tumblecal.thermal.record import write_thermal
    from tumblecal.thermal.result import thermal_calibration

    stated, sd = _stated(temperature), stated_noise_sd(noise_sd, None)
    files = recording_files(recordings, [context.table, context.plan])
    protect_inputs([*files, context.plan, context.table, temperature.calibration], folders=[out], names=_WRITTEN)
    with single_blas_thread(), output.working("reading"):
        reading = thermal_reading(
            files,
            context,
            options,
            criterion,
            bin_degc=temperature.bin_width,
            same_attitude=temperature.same_attitude,
            noise_sd=sd,
        )
    _printed(output, reading)
    with single_blas_thread(), output.working("fitting"):
        result = thermal_calibration(reading.table, stated)
    words = words_of_thermal(result, out)
    verdict = verdict_of_thermal(result, words)
    with output_folders([out]), result_set(out, _WRITTEN) as aside:
        written = write_thermal(aside, result, verdict.words().splitlines())
        written += write_thermal_page(aside / "thermal.html", result, words)
    output.say("\n".join(["", *verdict_lines(verdict, output.columns)]))
    for table in value_tables(result).values() if output.words else ():
        print()
        print_table(Console(), table)
    output.say(f"written: {out}/: {', '.join(written)}")
    if result.calibration.use.refused:
        output.warn(reading.table.source, [f"use: {result.calibration.use.words}"])
    output.record(out / "thermal.json")
    return NOT_USABLE if result.calibration.use.refused else 0


def _printed(output: Output, reading: "ThermalReading") -> None:
    """Print the layout, guesses and warnings of every source, then the branches and attitudes that were found."""
    from tumblecal.show.recordings import grouped_lines, layout_lines, left_out_lines

    output.say("\n".join(layout_lines(reading.read)))
    for recording in reading.read:
        output.warn(str(recording.path), left_out_lines(recording))
    for source, lines in reading.warnings:
        warn(source, lines)
    output.say("\n".join(grouped_lines(line.partition(": ")[::2] for line in reading.lines)))


def _stated(temperature: TemperatureOptions) -> "Stated":
    """What the options state.

    **Raises:** `InputError` for an option that cannot be read.
    """
    from tumblecal.data.calibration import read_calibration
    from tumblecal.thermal.choice import Stated

    orders = {leaf: _order(text) for leaf, text in _assigned("--order", temperature.order).items()}
    knots: dict[str, tuple[float, ...]] = {}
    for given in temperature.knots:
        leaf, _, numbers = given.partition("=")
        knots[_leaf("--knots", leaf)] = _numbers(given, numbers)
    if both := [leaf for leaf in knots if leaf in orders]:
        raise InputError(f"--order and --knots both state {both[0]}; give one of them")
    base = None
    if temperature.calibration is not None:
        base = read_calibration(temperature.calibration)
        base.use.require(temperature.calibration, anyway=False)
    return Stated(orders, knots, temperature.reference, base)


def _assigned(option: str, text: str) -> Mapping[str, str]:
    parts = [part.partition("=") for part in text.split(",") if part]
    return {_leaf(option, name): value for name, _, value in parts}


def _leaf(option: str, name: str) -> str:
    if name.strip() not in _LEAVES:
        raise InputError(f"{option}: no leaf {name.strip()!r}; leaves: {', '.join(_LEAVES)}")
    return _LEAVES[name.strip()]


def _order(text: str) -> int:
    from tumblecal.ground.temperature_functions import HIGHEST_ORDER

    if text.strip() not in [str(order) for order in range(HIGHEST_ORDER + 1)]:
        raise InputError(
            f"--order: {text.strip()!r} is not an order; write for example --order bias=3,scale=1 (0 to 5)"
        )
    return int(text)


def _numbers(given: str, text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"--knots {given}: write for example --knots bias=0,20,40 (degC)") from error
