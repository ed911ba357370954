"""`tumblecal check`: whether a calibration is still valid."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tumblecal.cli.command import Command, add_to_history, results, warn
from tumblecal.cli.options import Priors, ResultOptions, RigFile, Texts, options, within
from tumblecal.cli.recording_options import Context, Recording, Rest
from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


if TYPE_CHECKING:
    from tumblecal.check.drift import ProcessNoise
    from tumblecal.check.result import CheckResult, Model
    from tumblecal.check.update import Update
    from tumblecal.recordings.reduction import Reduction
    from tumblecal.show.words import Words

_SET = ("check.json", "check.html")


@options
class ConditionOptions:
    """Conditions of the check.

    Parameters
    ----------
    noise_sd
        Standard deviation of a position mean, with its unit. Default: by the dwells, or the sd columns; at least the dispersion
        of the positions of the calibration, if its noise was estimated. Example: --noise-sd 0.1mg.
    repeatability
        Standard deviation of a parameter or kind of parameter from one switch-on to the next, if the uncertainty of the
        calibration does not include it. Repeatable. Default: 0. Example: --repeatability 'bias=0.3 mg'.
    u_gravity
        Standard uncertainty of --gravity relative to its value. Default: 0 for the gravity of the calibration, otherwise 3e-5
        (anomalies). Example: --u-gravity 1e-6.
    largest_error
        Largest error of a corrected force that is acceptable in use. A changed calibration within it may be used. Default:
        none, so a changed calibration must not be used. Example: --largest-error 5mg.
    other_unit
        Check with a recording whose serial number differs from that of the calibration. Default: an error.
    extrapolate
        Check at temperatures outside the range of the calibration. Default: an error.
    use_anyway
        Check of a calibration with the judgement `use: no`. Default: an error.
    """

    noise_sd: str | None = None
    rig: RigFile = None
    prior: Priors = ()
    repeatability: Texts = ()
    u_gravity: Annotated[float | None, within(gte=0, lt=0.1)] = None
    largest_error: str = ""
    other_unit: bool = False
    extrapolate: bool = False
    use_anyway: bool = False

    def stated(self) -> dict[str, Any]:
        """Noise, acceptable error and repeatability in base units, and extrapolation, as keyword arguments of a check.

        **Raises:** `InputError` for a text that cannot be read.
        """
        from tumblecal.check.drift import by_parameter
        from tumblecal.data.sensor_parameters import UNITS
        from tumblecal.ground.option_texts import sd_of_reading, sizes

        again = sizes("--repeatability ", self.repeatability, UNITS, "'bias=0.3 mg'", zero=True)
        return {
            "noise_sd": sd_of_reading("--noise-sd", self.noise_sd),
            "largest_g": sd_of_reading("--largest-error", self.largest_error),
            "repeatability": by_parameter(again),
            "extrapolate": self.extrapolate,
        }


@options
class UpdateOptions:
    """A new calibration from the old one and the recording.

    Parameters
    ----------
    update
        File for the updated calibration. It is not written if the recording contradicts the calibration. Default: none.
        Example: --update updated.json.
    free
        Parameter or kind of parameter that changed: its old value is not used. Repeatable. Example: --free bias_x.
    drift
        Standard deviation of the drift of a parameter or kind of parameter, per month. Repeatable. Default: the drift of the
        unit by --history, if it has three or more results; otherwise none. Example: --drift 'bias=0.1 mg/month'.
    months
        Months from the calibration to the recording. Default: by their dates. Example: --months 12.
    """

    update: Path | None = None
    free: Texts = ()
    drift: Texts = ()
    months: Annotated[float | None, within(gte=0, lt=1200)] = None

    def rates(self, inputs: Sequence[Path | None]) -> dict[str, float]:
        """The drifts of `--drift` per month in base units, once the file of the update can be written.

        **Raises:** `InputError` for one that cannot be read, for an option without an update, and for a file that is an input
        of the command or cannot be written.
        """
        from tumblecal.data.overwriting import protect_inputs
        from tumblecal.data.sensor_parameters import UNITS
        from tumblecal.ground.atomic import writable_file
        from tumblecal.ground.option_texts import sizes

        if self.update is not None:
            protect_inputs(inputs, out=self.update)
            writable_file(self.update)
        elif self.free or self.drift:
            raise InputError(f"--{'free' if self.free else 'drift'} is for an update; give --update updated.json")
        drifts = [text.replace(" ", "").removesuffix("/month") for text in self.drift]
        return sizes("--drift ", drifts, UNITS, "'bias=0.1 mg/month'", zero=True)

    def updated(
        self, result: "CheckResult", source: dict[str, Any], rates: Mapping[str, float], history: Path | None
    ) -> "tuple[Update, ProcessNoise] | None":
        """The updated calibration, and the process noise since the old one; None without an update.

        **Arguments:**

        - `source`: provenance of the check. `rates`: as from `rates`. `history`: of the unit.

        **Raises:** `InputError` for a recording that contradicts the calibration, and for options that do not fit.
        """
        if self.update is None:
            return None
        from tumblecal.check.drift import process_noise
        from tumblecal.check.update import freed_names, updated
        from tumblecal.history.database import of_unit

        data, serial = result.data, result.serial_number
        entries = of_unit(history, serial) if history is not None and serial else None
        process = process_noise(result.calibration, data, rates, self.months, entries, str(history))
        return updated(result.test, process, freed_names(self.free), source), process


def check(
    calibration: Path,
    recording: list[Path],
    /,
    *,
    test: ConditionOptions = ConditionOptions(),
    updating: UpdateOptions = UpdateOptions(),
    context: Context = KnownContext(),
    options: Recording = RecordingOptions(),
    criterion: Rest = Criterion(),
    more: ResultOptions = ResultOptions(),
    out: Path = Path("check"),
    command: Command = Command(),
) -> int:
    """Check whether a calibration is still valid, by a few attitudes at rest.

    It tests the agreement with the calibration and its uncertainty, reports the smallest changes that the recording detects and
    those that it cannot see, and names the parameter that changed if the attitudes separate it. Exit code: 0; 2 for input that
    is rejected; 3 if the calibration must not be used. Next: tumblecal apply with the calibration.

    Parameters
    ----------
    calibration
        The calibration.json of calibrate, diagnose or thermal.
    recording
        Three or more attitudes at rest (by hand, or on a head), or one long still log: a recording of any format that reduce
        reads, several files of one recording, a position file, or a folder of tumblecal capture.
    out
        Output folder: check.json and check.html. Example: --out check17.
    """
    command.begin()
    from tumblecal.check.attitudes import provenance, still_attitudes
    from tumblecal.check.gravity import local_size
    from tumblecal.check.result import check as checked
    from tumblecal.data.calibration import write_calibration
    from tumblecal.data.file_kinds import require_calibration_and_recording
    from tumblecal.data.result_records import read_checked
    from tumblecal.ground.gravity import gravity_of_option
    from tumblecal.history.database import ready
    from tumblecal.recordings.dwells.file_names import recording_files
    from tumblecal.show.check import words_of_check
    from tumblecal.show.verdict import verdict_lines

    require_calibration_and_recording(calibration, recording)
    read, update, made, refused = read_checked(calibration), updating.update, None, None
    read.use.require(calibration, anyway=test.use_anyway)
    files = recording_files(recording, [context.table, context.plan])
    inputs = [calibration, *files, context.plan, context.table, test.rig, more.history]
    rates, stated = updating.rates(inputs), test.stated()
    if more.history is not None:
        ready(more.history)
    with results(out, _SET, inputs) as aside:
        with command.working("reading"):
            found = still_attitudes(files, context, replace(options, gravity=""), criterion)
        command.print_recordings(found.dwells.read, found.dwells.warnings, _interval_lines(found))
        source, serial = provenance(found, calibration, read), found.data.serial_number or read.serial_number
        read.require_unit(calibration, found.data.source, serial, other=test.other_unit)
        local = gravity_of_option(options.gravity) if options.gravity else None
        gravity, data = local_size(read, found.data, local, test.u_gravity, str(calibration))
        model = _model(test, data.hand_held, data.source)
        with command.working("testing"):
            result = checked(read, calibration, data, model=model, gravity=gravity, **stated)
        try:
            made = updating.updated(result, source, rates, more.history)
        except InputError as fault:
            refused = fault
        words = words_of_check(result, [calibration, *found.dwells.files], made, update)
        _write(aside, result, words, source, made and made[0], more)
    if made is not None and update is not None:
        write_calibration(update, made[0].calibration)
    add_to_history(more.history, out, "check", serial)
    command.say(*verdict_lines(words.verdict, command.columns))
    code = command.end(out, _SET, "check.json", result.use, data.source, f"; {update}" if made else "")
    if refused is not None:
        raise refused
    return code


def _write(
    folder: Path,
    result: "CheckResult",
    words: "Words",
    source: dict[str, Any],
    update: "Update | None",
    more: ResultOptions,
) -> None:
    """Write the files of the check; `source`: its provenance."""
    from tumblecal.check.record import CheckRecord
    from tumblecal.show.figures.check import FIGURES
    from tumblecal.show.page import write_page
    from tumblecal.show.verdict import verdict_lines

    CheckRecord.of(result, **source, update=update, text="\n".join(verdict_lines(words.verdict))).write(
        folder / "check.json"
    )
    if more.figures is not False:
        write_page(folder / "check.html", words, FIGURES, result)


def _interval_lines(found: "Reduction") -> list[str]:
    """How the attitudes were found: the number of intervals at rest, and those that were rejected."""
    from tumblecal.show.recordings import words_of_reduction

    words = words_of_reduction(found.dwells)
    blocks = ("intervals", "steps", "rejected")
    return [*found.dwells.lines, *(line for block in blocks for line in words.lines(block))]


def _model(test: ConditionOptions, hand_held: bool, source: str) -> "Model":
    """The model of known angles: of --rig and --prior."""
    from tumblecal.check.result import Model
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.cli.options import ModelOptions

    if not (test.rig or test.prior):
        return Model()
    if hand_held:
        option = "--rig" if test.rig else "--prior"
        raise InputError(f"{option}: the angles of {source} are unknown; omit it, or give angles (--plan, --table)")
    model = StatedModel.of(ModelOptions(rig=test.rig, prior=test.prior))
    if model.rig is not None and (unused := model.rig.tables_of_head):
        warn(model.rig.source, [f"not used by `check`: {', '.join(unused)}"])
    return Model(lambda data: model.chain(data, known=True), model.priors)
