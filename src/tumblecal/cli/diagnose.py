"""`tumblecal diagnose`."""

from collections.abc import Sequence
from pathlib import Path


def diagnose(
    data: list[Path],
    /,
    *,
    rig: Path | None = None,
    out: Path = Path("diagnosis"),
    noise_sd: str | None = None,
    prior: Sequence[str] = (),
    holdout: str | None = None,
    effects: Sequence[Path] = (),
    allow_alpha: Sequence[float] = (),
    allow_beta: Sequence[float] = (),
    figures: bool | None = None,
) -> int:
    """Find what the model gets wrong in measured positions, and why.

    Parameters
    ----------
    data
        Position files, .csv or .parquet. Several files are diagnosed one by one, each into its own subfolder.
    rig
        The rig, a TOML file; inferred from the angle columns where left out.
    out
        Folder for diagnosis.json, verdict.txt, calibration.json of the extended model, the figures and diagnosis.html,
        which holds all of it; summary.csv where there are several files.
    noise_sd
        Standard deviation of a reading with its unit, e.g. 0.1mg; else the sd columns; else it counts as unknown.
    prior
        What is known of a parameter, e.g. --prior 'dbeta=3 arcmin' (sd around zero); may be given several times.
    holdout
        Data kept out of the fit when the gain is measured, e.g. run=3.
    effects
        Python file with effects of your own; may be given several times.
    allow_alpha
        Spindle angle (deg) that a proposed next position may use; may be given several times.
    allow_beta
        Pitch angle (deg) that a proposed next position may use; may be given several times.
    figures
        Draw the figures (SVG) and write the page; by default only for a single file.
    """
    from tumblecal.cli.start import start

    start()
    from tumblecal.cli.model import Model
    from tumblecal.data import read_positions
    from tumblecal.data.atomic import writable_folder
    from tumblecal.diagnosis import Diagnoser
    from tumblecal.diagnosis.verdict import verdict_text
    from tumblecal.effects import catalogue
    from tumblecal.errors import InputError
    from tumblecal.report.diagnosis_files import write_diagnosis
    from tumblecal.report.diagnosis_summary import summary_row, write_summary

    model = Model.of(rig, noise_sd, prior, ())
    kept_out = _holdout(holdout)
    grid = (tuple(allow_alpha), tuple(allow_beta)) if allow_alpha and allow_beta else None
    diagnoser = Diagnoser(catalogue(*effects), plan_next=len(data) == 1, nested=len(data) == 1, grid=grid)
    folders = _folders(data, out)
    read = [read_positions(file, check_size=False) for file in data]
    writable_folder(out)
    faults: list[str] = []
    rows: list[dict] = []
    try:
        for number, (file, folder, positions) in enumerate(zip(data, folders, read, strict=True), start=1):
            count = f"{number} of {len(data)}  {file}"
            try:
                found = diagnoser(
                    positions,
                    chain=model.chain(positions) if rig is not None else None,
                    noise_sd=model.noise_sd,
                    priors=model.priors,
                    holdout=kept_out,
                )
            except InputError as error:
                faults += error.faults
                rows.append(summary_row(file, error))
                if len(data) > 1:
                    print(f"{count}: refused", flush=True)
                continue
            rows.append(summary_row(file, found))
            text = f"{count}: {found.verdict}; {', '.join(found.labels) or 'nothing found'}"
            print(verdict_text(found) if len(data) == 1 else text, flush=True)
            write_diagnosis(folder, found, figures=len(data) == 1 if figures is None else figures)
    finally:
        # An interrupted batch leaves the lines of what was finished.
        if len(data) > 1:
            write_summary(out / "summary.csv", rows)
    if faults:
        raise InputError(faults)
    return 0


def _folders(files: Sequence[Path], out: Path) -> list[Path]:
    """One folder for a single file, else one for each, named after the files."""
    from tumblecal.errors import InputError

    if len(files) == 1:
        return [out]
    stems = [file.stem for file in files]
    twice = sorted({stem for stem in stems if stems.count(stem) > 1})
    if twice:
        raise InputError(
            f"several files are named {', '.join(twice)}: their results would overwrite each other; rename them"
        )
    return [out / stem for stem in stems]


def _holdout(text: str | None) -> tuple[str, str] | None:
    from tumblecal.errors import InputError

    if text is None:
        return None
    column, equals, value = text.partition("=")
    if not equals or not value:
        raise InputError(f"--holdout {text}: write a column and a value, such as run=3")
    return column.strip(), value.strip()
