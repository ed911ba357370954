"""`tumblecal check`: whether a calibration is still valid."""

from dataclasses import replace
from pathlib import Path

from tumblecal.cli.check_options import ConditionOptions
from tumblecal.cli.command import Command
from tumblecal.cli.options import ResultOptions
from tumblecal.cli.recording_options import Context, Recording, Rest, print_recordings
from tumblecal.cli.result_files import add_to_history, results
from tumblecal.cli.update_options import UpdateOptions
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


_SET = ("check.json", "check.html")


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
    from tumblecal.check.attitudes import still_attitudes
    from tumblecal.check.of_recording import check_recording
    from tumblecal.data.calibration import write_calibration
    from tumblecal.data.file_kinds import require_calibration_and_recording
    from tumblecal.data.result_records import read_checked
    from tumblecal.ground.gravity import gravity_of_option
    from tumblecal.recordings.dwells.file_names import recording_files
    from tumblecal.show.check import words_of_check, write_check
    from tumblecal.show.recordings import interval_lines

    require_calibration_and_recording(calibration, recording)
    read, update = read_checked(calibration), updating.update
    read.use.require(calibration, anyway=test.use_anyway)
    files = recording_files(recording, [context.table, context.plan])
    inputs = [calibration, *files, context.plan, context.table, test.rig, more.history]
    rates = updating.rates(inputs)
    stated, local = test.stated(), gravity_of_option(options.gravity) if options.gravity else None
    more.require_history()
    with results(out, _SET, inputs) as aside:
        with command.working("reading"):
            found = still_attitudes(files, context, replace(options, gravity=""), criterion)
        print_recordings(command, found.dwells.read, found.dwells.warnings, interval_lines(found.dwells))
        with command.working("testing"):
            result, source = check_recording(read, calibration, found, local=local, **stated)
        made, refused = updating.updated(result, source, rates, more.history)
        words = words_of_check(result, [calibration, *found.dwells.files], made, update)
        write_check(aside, result, words, source, made and made[0], figures=more.figures is not False)
    if made is not None and update is not None:
        write_calibration(update, made[0].calibration)
    add_to_history(more.history, out, "check", result.serial_number)
    command.print_verdict(words.verdict)
    code = command.end(out, _SET, "check.json", result.use, result.data.source, f"; {update}" if made else "")
    if refused is not None:
        raise refused
    return code
