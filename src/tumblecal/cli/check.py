"""`tumblecal check`: whether a calibration is still valid."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.calibrate import NOT_USABLE
from tumblecal.cli.check_options import ConditionOptions, UpdateOptions
from tumblecal.cli.options import ResultOptions
from tumblecal.cli.output import Output, warn
from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


if TYPE_CHECKING:
    from tumblecal.check.drift import ProcessNoise
    from tumblecal.check.gravity import LocalSize
    from tumblecal.check.result import CheckResult, Model
    from tumblecal.check.update import Update
    from tumblecal.data.calibration import Calibration
    from tumblecal.recordings.reduction import Reduction

_SET = ("check.json", "check.html")


def check(
    calibration: Path,
    recording: list[Path],
    /,
    *,
    test: ConditionOptions = ConditionOptions(),
    updating: UpdateOptions = UpdateOptions(),
    context: Annotated[KnownContext, Parameter(name="*")] = KnownContext(),
    options: Annotated[RecordingOptions, Parameter(name="*")] = RecordingOptions(),
    criterion: Annotated[Criterion, Parameter(name="*")] = Criterion(),
    results: ResultOptions = ResultOptions(),
    out: Path = Path("check"),
    output: Output = Output(),
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
    from tumblecal.cli.start import start

    output.begin()
    start()
    from tumblecal.check.attitudes import still_attitudes
    from tumblecal.check.drift import by_parameter
    from tumblecal.check.result import check as checked
    from tumblecal.data.file_kinds import require_calibration_and_recording
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.data.result_records import read_checked
    from tumblecal.ground.blas import single_blas_thread
    from tumblecal.recordings.dwells.file_names import recording_files

    require_calibration_and_recording("check", calibration, recording)
    read = read_checked(calibration)
    read.use.require(calibration, anyway=test.use_anyway)
    files = recording_files(recording, [context.table, context.plan])
    inputs = [calibration, *files, context.plan, context.table, test.rig, results.history]
    protect_inputs(inputs, folders=[out], names=_SET)
    if updating.update is not None:
        protect_inputs(inputs, out=updating.update)
    elif updating.free or updating.drift:
        raise InputError(f"--{'free' if updating.free else 'drift'} is for an update; give --update updated.json")
    noise_sd, largest_g = test.sizes()
    repeated = by_parameter(test.repeated())
    rates = updating.rates()
    results.ready()
    with single_blas_thread(), output.working("reading"):
        found = still_attitudes(files, context, replace(options, gravity=""), criterion)
    _printed(output, found)
    _require_unit(read, calibration, found, other=test.other_unit)
    gravity, found = _gravity(read, calibration, found, options.gravity, test.u_gravity)
    _require_new(read, calibration, found)
    with output.working("testing"):
        result = checked(
            read,
            calibration,
            found.data,
            model=_model(test, found),
            noise_sd=noise_sd,
            gravity=gravity,
            extrapolate=test.extrapolate,
            largest_g=largest_g,
            repeatability=repeated,
        )
        made, refused = None, None
        try:
            made = _updated(result, found, updating, rates, results.history)
        except InputError as fault:
            refused = fault
    stated = [calibration, *found.dwells.files, *_stated(context, test)]
    _written(result, found, made, (updating.update, stated), results, out, output)
    if refused is not None:
        raise refused
    return NOT_USABLE if result.use.refused else 0


def _printed(output: Output, found: "Reduction") -> None:
    """Print layout, guesses and warnings of the recording."""
    from tumblecal.show.recordings import layout_lines, left_out_lines, words_of_reduction

    output.say("\n".join(found.dwells.lines))
    output.say("\n".join(layout_lines(found.dwells.read)))
    words = words_of_reduction(found.dwells)
    output.say("\n".join(line for block in ("intervals", "steps", "rejected") for line in words.lines(block)))
    for recording in found.dwells.read:
        output.warn(str(recording.path), left_out_lines(recording))
    for source, lines in found.dwells.warnings:
        warn(source, lines)


def _require_unit(read: "Calibration", path: Path, found: "Reduction", *, other: bool) -> None:
    """Reject a recording of a different unit.

    **Raises:** `InputError` if the serial numbers differ, unless `other` is set.
    """
    stated = found.data.serial_number
    if read.serial_number and stated and stated != read.serial_number and not other:
        raise InputError(
            f"{found.data.source}: serial number {stated}, but {path} is of {read.serial_number}; give that unit's "
            "calibration, or --other-unit to insist"
        )


def _require_new(read: "Calibration", path: Path, found: "Reduction") -> None:
    """Reject the data of the calibration itself, which agree with it whatever happened since.

    **Raises:** `InputError` with the file.
    """
    from tumblecal.check.attitudes import provenance

    used = read.provenance.get("sha256")
    for record in provenance(found, path)["recording"]:
        if used is not None and record["sha256"] == used:
            raise InputError(f"{record['file']}: {path} was made from this file; check it with a new recording")


def _gravity(
    read: "Calibration", path: Path, found: "Reduction", stated: str, u: float | None
) -> "tuple[LocalSize, Reduction]":
    from tumblecal.check.gravity import local_size
    from tumblecal.ground.gravity import gravity_of_option

    if u is not None and not 0 <= u < 0.1:
        raise InputError(f"--u-gravity {u:g}: a relative standard uncertainty from 0 to 0.1, such as 1e-5")
    local = gravity_of_option(stated) if stated else None
    gravity, data = local_size(read, found.data, local, u, str(path))
    return gravity, replace(found, data=data)


def _model(test: ConditionOptions, found: "Reduction") -> "Model":
    """The model of known angles: of --rig and --prior."""
    from tumblecal.check.result import Model
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.cli.options import ModelOptions

    if found.data.hand_held:
        if test.rig or test.prior:
            option = "--rig" if test.rig else "--prior"
            raise InputError(
                f"{option}: the angles of {found.data.source} are unknown; omit it, or give angles (--plan, --table)"
            )
        return Model()
    model = StatedModel.of(ModelOptions(rig=test.rig, prior=test.prior))
    if model.rig is not None and (unused := model.rig.tables_of_head):
        warn(model.rig.source, [f"not used by `check`: {', '.join(unused)}"])
    return Model(lambda data: model.chain(data, known=True), model.priors)


def _updated(
    result: "CheckResult",
    found: "Reduction",
    updating: UpdateOptions,
    rates: Mapping[str, float],
    history: Path | None,
) -> "tuple[Update, ProcessNoise] | None":
    """The update, if one is asked for, and its process noise.

    **Raises:** `InputError` if the recording contradicts the calibration, and for unusable options.
    """
    if updating.update is None:
        return None
    from tumblecal.check.attitudes import provenance
    from tumblecal.check.drift import process_noise
    from tumblecal.check.update import freed_names, updated
    from tumblecal.history.database import of_unit

    freed = freed_names(updating.free)
    serial = found.data.serial_number or result.calibration.serial_number
    entries = of_unit(history, serial) if history is not None and serial else None
    process = process_noise(result.calibration, found.data, rates, updating.months, entries, str(history))
    return updated(result.test, process, freed, provenance(found, result.path)), process


def _stated(context: KnownContext, test: ConditionOptions) -> list[Path | str]:
    """Options for suggested commands, in addition to those that `suggested` repeats."""
    values = {"--plan": context.plan, "--table": context.table, "--by": context.by}
    values |= {"--u-gravity": None if test.u_gravity is None else f"{test.u_gravity:g}"}
    flags = {"--static": context.static, "--means": context.means, "--other-unit": test.other_unit}
    flags |= {"--extrapolate": test.extrapolate, "--use-anyway": test.use_anyway}
    words: list[Path | str] = [word for name, value in values.items() if value for word in (name, value)]
    words += [word for text in test.repeatability for word in ("--repeatability", text)]
    return [*words, *(name for name, given in flags.items() if given)]


def _written(
    result: "CheckResult",
    found: "Reduction",
    made: "tuple[Update, ProcessNoise] | None",
    given: tuple[Path | None, list[Path | str]],
    results: ResultOptions,
    out: Path,
    output: Output,
) -> None:
    """Write and print the results. `given`: the file of the update, and the words of suggested commands."""
    from tumblecal.check.attitudes import provenance
    from tumblecal.check.record import write_check
    from tumblecal.data.calibration import write_calibration
    from tumblecal.ground.atomic import output_folders, writable_file
    from tumblecal.ground.result_set import result_set
    from tumblecal.show.check import verdict_of_check, words_of_check, write_check_page
    from tumblecal.show.verdict import verdict_lines

    file, stated = given
    words = words_of_check(result, stated, made, file)
    verdict = verdict_of_check(result, words)
    update = made[0] if made is not None else None
    if file is not None:
        writable_file(file)
    with output_folders([out]), result_set(out, _SET) as aside:
        write_check(
            aside / "check.json", result, "\n".join(verdict_lines(verdict)), provenance(found, result.path), update
        )
        written = ["check.json"]
        if results.figures is not False:
            written += write_check_page(aside / "check.html", result, words)
    if update is not None and file is not None:
        write_calibration(file, update.calibration)
    results.in_history(out, "check", found.data.serial_number or result.calibration.serial_number)
    output.say("\n".join(verdict_lines(verdict, output.columns)))
    output.say(f"written: {out}/: {', '.join(written)}{'' if update is None else f'; {file}'}")
    if result.use.refused:
        output.warn(result.data.source, [f"use: {result.use.words}"])
    output.record(out / "check.json")
