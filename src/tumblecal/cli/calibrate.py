"""`tumblecal calibrate`: position files by all methods."""

from dataclasses import replace
from pathlib import Path

from tumblecal.cli.options import ModelOptions
from tumblecal.cli.output import Output


_WRITTEN = ("result.json", "calibration.json", "*.svg")


def calibrate(
    data: list[Path],
    /,
    *,
    options: ModelOptions = ModelOptions(),
    out: Path = Path("calibration"),
    figures: bool = False,
    output: Output = Output(),
) -> int:
    """Calibrate position files by all methods, exact and linear.

    Parameters
    ----------
    data
        Position files, .csv or .parquet. Several files are calibrated one by one, each into its own subfolder.
    out
        Folder for result.json and calibration.json.
    figures
        Draw the residuals and the comparison of the methods (SVG).
    """
    from tumblecal.cli.start import start

    output.begin()
    start()
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.estimation.methods import all_methods
    from tumblecal.ground.atomic import output_folders
    from tumblecal.report.result_file import write_calibrated
    from tumblecal.report.terminal import print_calibration

    model = StatedModel.of(options)
    sets = [model.read(path) for path in data]
    folders = subfolders(data, out)
    inputs_kept([*data, options.rig, options.head, *options.effects], folders=folders, names=_WRITTEN)
    good = True
    with output_folders(folders):
        for given, folder in zip(sets, folders, strict=True):
            with output.working(f"calibrating {given.source}"):
                positions, mix_ups = model.checked(given)
                calibrated = replace(all_methods(model.problem(positions), usual=model.usual), mix_ups=tuple(mix_ups))
            if output.words:
                print_calibration(calibrated)
            good &= calibrated.exact.code.good
            written = write_calibrated(folder, calibrated)
            if figures:
                from tumblecal.report.calibration_figures import draw_calibration

                written += draw_calibration(folder, calibrated)
            output.say(f"written: {folder}/: {', '.join(written)}")
            output.record(folder / "result.json")
    return 0 if good else 1


def subfolders(files: list[Path], out: Path) -> list[Path]:
    """The folder of each file: `out` itself for one file, else `out/<stem>`, numbered where stems are the same."""
    if len(files) == 1:
        return [out]
    folders: list[Path] = []
    for path in files:
        folder, number = out / path.stem, 1
        while folder in folders:
            number += 1
            folder = out / f"{path.stem}-{number}"
        folders.append(folder)
    return folders
