"""`tumblecal diagnose`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING


if TYPE_CHECKING:
    from tumblecal.capture.position_samples import PositionSamples


def diagnose(
    data: list[Path],
    /,
    *,
    rig: Path | None = None,
    out: Path = Path("diagnosis"),
    noise_sd: str | None = None,
    samples: Path | None = None,
    prior: Sequence[str] = (),
    fix: Sequence[str] = (),
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
        Folder for diagnosis.json, verdict.txt, calibration.json of the extended model, and the figures.
    noise_sd
        Standard deviation of a reading with its unit, e.g. 0.1mg; else the sd columns; else it counts as unknown.
    samples
        The raw samples that the means were made of: the folder of tumblecal capture, or a table (.csv, .parquet) with
        columns position, ax_g, ay_g, az_g, time_s. Their noise, slow parts included, then weighs the positions.
    prior
        What is known of a parameter, e.g. --prior 'dbeta=3 arcmin' (sd around zero); may be given several times.
    fix
        Keep a parameter at its nominal value, e.g. --fix dbeta; may be given several times.
    holdout
        Data kept out of the fit when the gain is measured, e.g. run=3.
    effects
        Python file with effects of your own; may be given several times.
    allow_alpha
        Spindle angle (deg) that a proposed next position may use; may be given several times.
    allow_beta
        Pitch angle (deg) that a proposed next position may use; may be given several times.
    figures
        Draw the figures (SVG); by default only for a single file.
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

    model = Model.of(rig, noise_sd, prior, fix)
    kept_out = _holdout(holdout)
    grid = (tuple(allow_alpha), tuple(allow_beta)) if allow_alpha and allow_beta else None
    diagnoser = Diagnoser(catalogue(*effects), plan_next=len(data) == 1, grid=grid)
    raw = _samples(samples, data, noise_sd)
    folders = _folders(data, out)
    read = [read_positions(file, check_size=False) for file in data]
    writable_folder(out)
    faults: list[str] = []
    for file, folder, positions in zip(data, folders, read, strict=True):
        try:
            found = diagnoser(
                positions,
                chain=model.chain(positions) if rig is not None or fix else None,
                noise_sd=model.noise_sd,
                priors=model.priors,
                holdout=kept_out,
                samples=raw,
            )
        except InputError as error:
            faults += error.faults
            continue
        text = verdict_text(found)
        print(
            text if len(data) == 1 else f"{file}: {found.verdict}; {', '.join(found.labels) or 'nothing found'}",
            flush=True,
        )
        write_diagnosis(folder, found, figures=len(data) == 1 if figures is None else figures)
    if faults:
        raise InputError(faults)
    return 0


def _samples(path: Path | None, data: Sequence[Path], noise_sd: str | None) -> "PositionSamples | None":
    """The raw samples, where given.

    **Raises:** `InputError` when they cannot be those of the data, or the noise is stated a second time.
    """
    from tumblecal.errors import InputError

    if path is None:
        return None
    if noise_sd is not None:
        raise InputError("--samples and --noise-sd both say how large the noise is; give one of them")
    if len(data) > 1:
        raise InputError(
            f"--samples {path}: belongs to one file of positions, but {len(data)} are given; run them apart"
        )
    from tumblecal.capture.position_samples import read_position_samples

    return read_position_samples(path)


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
