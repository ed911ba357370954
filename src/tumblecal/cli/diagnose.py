"""`tumblecal diagnose`."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def diagnose(
    files: Annotated[tuple[Path, ...], Parameter(negative=())],
    /,
    *,
    out: Path,
    rig: Path | None = None,
    noise_sd: str | None = None,
    prior: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    holdout: str | None = None,
    effects: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    figures: bool | None = None,
) -> None:
    """Find what the model gets wrong in measured positions, and why.

    Parameters
    ----------
    files
        Position files (CSV or Parquet); several are diagnosed one by one, each into a folder of its own.
    out
        Folder for diagnosis.json, verdict.txt, the figures and calibration.json of the extended model.
    rig
        Rig file (TOML) with the nominal model; the paper's chain without it.
    noise_sd
        Standard deviation of every reading, such as 0.1mg; else the sd columns; else it counts as unknown.
    prior
        What is known of a parameter, such as 'dbeta=3 arcmin' (sd around zero); needs the noise.
    holdout
        Data to keep out of the fit when the gain is measured, such as run=3.
    effects
        Python files with effects of your own.
    figures
        Draw the figures; by default only for a single file.
    """
    from tumblecal import enable_float64

    enable_float64()
    from tumblecal.data import read_positions
    from tumblecal.data.atomic import write_text, writable_folder
    from tumblecal.diagnosis import Diagnoser
    from tumblecal.diagnosis.record import write_record
    from tumblecal.diagnosis.verdict import verdict_text
    from tumblecal.effects import catalogue
    from tumblecal.errors import InputError
    from tumblecal.report.diagnosis_calibration import write_extended_calibration

    if not files:
        raise InputError("no files to diagnose; give one or more position files")
    options = _options(noise_sd, prior, holdout)
    diagnoser = Diagnoser(catalogue(*effects))
    folders = _folders(files, out)
    read = [read_positions(file, check_size=False) for file in files]
    writable_folder(out)
    faults = []
    for file, folder, data in zip(files, folders, read, strict=True):
        if rig is not None:
            options["chain"] = _rig_chain(rig, data)
        try:
            found = diagnoser(data, **options)
        except InputError as error:
            faults += error.faults
            continue
        text = verdict_text(found)
        print(text if len(files) == 1 else f"{file}: {text.splitlines()[0]} {', '.join(found.labels)}", flush=True)
        writable_folder(folder)
        write_record(folder / "diagnosis.json", found)
        write_extended_calibration(folder, found)
        write_text(folder / "verdict.txt", text + "\n")
        if figures if figures is not None else len(files) == 1:
            from tumblecal.report.diagnosis_figures import draw_all

            draw_all(found, folder)
    if faults:
        raise InputError(faults)


def _folders(files: tuple[Path, ...], out: Path) -> list[Path]:
    """One folder for a single file, else one for each, named after the files."""
    from tumblecal.errors import InputError

    if len(files) == 1:
        return [out]
    stems = [file.stem for file in files]
    twice = sorted({stem for stem in stems if stems.count(stem) > 1})
    if twice:
        raise InputError(f"several files are named {', '.join(twice)}: their results would overwrite each other; rename them")
    return [out / stem for stem in stems]


def _options(noise_sd: str | None, prior: tuple[str, ...], holdout: str | None) -> dict:
    from tumblecal.chain.units import quantity
    from tumblecal.errors import InputError

    options: dict = {}
    if noise_sd is not None:
        options["noise_sd"] = quantity(noise_sd, "g")
    if prior:
        options["priors"] = dict(_prior(text) for text in prior)
    if holdout is not None:
        column, equals, value = holdout.partition("=")
        if not equals or not value:
            raise InputError(f"--holdout {holdout}: write a column and a value, such as run=3")
        options["holdout"] = (column.strip(), value.strip())
    return options


def _prior(text: str) -> tuple[str, tuple[float, float]]:
    """`dbeta=3 arcmin` -> ("dbeta", (0, 3 arcmin in rad))."""
    from tumblecal.chain.units import quantity
    from tumblecal.errors import InputError

    name, equals, size = text.partition("=")
    if not equals:
        raise InputError(f"--prior {text}: write a parameter and its sd, such as 'dbeta=3 arcmin'")
    base = {"dbeta": "rad", "dtheta": "rad", "gamma": "rad", "bias": "g", "dK": "1"}
    unit = next((unit for start, unit in base.items() if name.strip().startswith(start)), "1")
    return name.strip(), (0.0, quantity(size, unit))


def _rig_chain(path: Path, data):
    from tumblecal.chain.rig import read_rig
    from tumblecal.estimation.problem import where_of

    return read_rig(path).chain(where_of(data))
