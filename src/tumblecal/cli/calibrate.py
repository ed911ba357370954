"""`tumblecal calibrate`: position files by all methods."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.options import ModelOptions
from tumblecal.cli.output import Output


if TYPE_CHECKING:
    from tumblecal.estimation.methods import Calibrated


_WRITTEN = ("result.json", "calibration.json", "calibration.html", "*.svg")


def calibrate(
    data: list[Path],
    /,
    *,
    options: ModelOptions = ModelOptions(),
    out: Path = Path("calibration"),
    figures: bool | None = None,
    output: Output = Output(),
) -> int:
    """Calibrate position files by all methods, exact and linear.

    Parameters
    ----------
    data
        Position files, .csv or .parquet. Several files are calibrated one by one, each into its own subfolder.
    out
        Folder for result.json, calibration.json, the figures and calibration.html, which holds all of it.
    figures
        Draw the figures (SVG) and write the page; by default only for a single file.
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
            if len(data) == 1 if figures is None else figures:
                with output.working("drawing"):
                    written += _drawn(folder, calibrated)
            output.say(f"written: {folder}/: {', '.join(written)}")
            output.record(folder / "result.json")
    return 0 if good else 1


def _drawn(folder: Path, calibrated: "Calibrated") -> list[str]:
    """Draw the figures and write the page; returns their names."""
    from tumblecal.report.calibration_figures import draw_calibration
    from tumblecal.report.calibration_page import write_calibration_page

    drawn = draw_calibration(folder, calibrated)
    return [*drawn, write_calibration_page(folder / "calibration.html", calibrated, drawn).name]


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
