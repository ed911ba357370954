"""`tumblecal calibrate`: position files by all methods."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.join_options import JoinOptions
from tumblecal.cli.options import ModelOptions, ResultOptions
from tumblecal.cli.output import Output
from tumblecal.cli.subfolders import subfolders
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.data import PositionSet
    from tumblecal.estimation.methods import Calibrated


# Exit code where a calibration must not be used.
NOT_USABLE = 3
# The files of one calibration, and the table of several.
_SET = ("result.json", "calibration.json", "calibration.html", "residuals.svg", "methods.svg")
_SUMMARY = "summary.csv"


def calibrate(
    data: list[Path],
    /,
    *,
    options: ModelOptions = ModelOptions(),
    joining: JoinOptions = JoinOptions(),
    out: Path = Path("calibration"),
    results: ResultOptions = ResultOptions(),
    output: Output = Output(),
) -> int:
    """Calibrate position files by the exact method and all linear methods.

    Exit code: 0; 2 for input that is rejected; 3 if a calibration must not be used (`use: no`), with all files written.

    Parameters
    ----------
    data
        Position files (.csv or .parquet). Several files are a batch: each has a subfolder, and a faulty file is skipped. With
        --join they are one measurement.
    out
        Output folder: result.json, calibration.json, figures, calibration.html (all results) and, for a batch, summary.csv.
        A folder with results of diagnose is rejected. Example: --out unit17.
    """
    from tumblecal.cli.start import start

    output.begin()
    start()
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.data.overwriting import CALIBRATION, protect_inputs, protect_other_results
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.result_set import remove_results

    joining.check()
    model, single = StatedModel.of(options), joining.join or len(data) == 1
    folders = subfolders(data[:1] if joining.join else data, out)
    given = [*data, options.rig, options.head, *options.effects]
    protect_inputs([*given, results.history], folders=[*folders, out], names=(*_SET, _SUMMARY))
    protect_other_results(CALIBRATION, [*folders, out])
    results.ready()
    sets = model.read_each(data, together=single)
    if joining.join:
        whole, words = joining.joined([part for part in sets if not isinstance(part, InputError)], model.rig)
        output.say(words)
        sets, data = [whole], data[:1]
    model.compare_with_plan(sets)
    usable, faults, rows = True, list[str](), list[dict]()
    with output_folders([out]):
        for number, (file, positions, folder) in enumerate(zip(data, sets, folders, strict=True), start=1):
            with output.working(f"calibrating {file}"):
                calibrated = _calibrated(model, positions, alone=single)
            if isinstance(calibrated, InputError):
                faults += calibrated.faults
            else:
                usable &= not calibrated.use.refused
                if not single:
                    remove_results(out, (_SUMMARY,))  # it describes the results before the first one is replaced
                head_record = model.of_head(calibrated.exact.problem)
                _report(output, folder, calibrated, results, head_record=head_record, single=single)
            if not single:
                rows.append(_row(file, calibrated))
                output.say(f"{number} of {len(data)}  {file}: {rows[-1]['judgement']}{_lacking(calibrated)}")
        if not single:
            from tumblecal.report.summary import CALIBRATED, write_summary

            write_summary(out / _SUMMARY, rows, CALIBRATED)
            output.say(f"written: {out}/: summary.csv, a folder for each file")
    if faults:
        raise InputError(faults)
    return 0 if usable else NOT_USABLE


def _calibrated(
    model: "StatedModel", positions: "PositionSet | InputError", *, alone: bool
) -> "Calibrated | InputError":
    """The fits of all methods; for a file of a batch that cannot be calibrated, its fault.

    **Raises:** `InputError` for a single file that cannot be calibrated.
    """
    from tumblecal.estimation.methods import all_methods

    if isinstance(positions, InputError):
        return positions
    try:
        checked, setup_errors = model.checked(positions)
        calibrated = all_methods(model.problem(checked), usual=model.usual, by_columns=model.noise_sd is None)
        unusual = model.with_sources(calibrated.implausible, calibrated.exact.problem)
        return replace(calibrated, setup_errors=tuple(setup_errors), implausible=unusual, entries=model.entries)
    except InputError as fault:
        if alone:
            raise
        return fault


def _row(file: Path, calibrated: "Calibrated | InputError") -> dict:
    """The row of the summary; polars is imported for a batch only."""
    from tumblecal.report.summary import calibration_row

    return calibration_row(file, calibrated)


def _lacking(calibrated: "Calibrated | InputError") -> str:
    """Effects and parameters that the calibration of a batch file does not include; printed after its judgement."""
    from tumblecal.lab.sensor_terms import lacking_of_fit

    if isinstance(calibrated, InputError):
        return ""
    return "".join(f" ({words})" for words in lacking_of_fit(calibrated.exact, calibrated.entries, of_sensor=True))


def _report(
    output: Output, folder: Path, calibrated: "Calibrated", results: ResultOptions, *, head_record: dict, single: bool
) -> None:
    """Write the results of one file, with the record of the head in its provenance; print the table of a single file."""
    from tumblecal.ground.result_set import result_set
    from tumblecal.report.calibration_words import warning_words
    from tumblecal.report.result_file import write_calibrated

    with result_set(folder, _SET) as aside:
        written = write_calibrated(aside, calibrated, head_record)
        if single if results.figures is None else results.figures:
            with output.working("drawing"):
                written += _drawn(aside, calibrated)
    results.in_history(folder, "calibration", calibrated.exact.data.serial_number)
    if output.words and single:
        from tumblecal.report.terminal import print_calibration

        print_calibration(calibrated)
        output.say(f"written: {folder}/: {', '.join(written)}")
    output.warn(calibrated.exact.data.source, warning_words(calibrated))
    output.record(folder / "result.json")


def _drawn(folder: Path, calibrated: "Calibrated") -> list[str]:
    """Draw the figures and write the page; returns their names."""
    from tumblecal.report.calibration_page import write_calibration_page
    from tumblecal.show.figures.calibration import FIGURES
    from tumblecal.show.figures.drawing import write_each

    drawn = write_each(folder, FIGURES, calibrated)
    return [*drawn, *write_calibration_page(folder / "calibration.html", calibrated, drawn)]
