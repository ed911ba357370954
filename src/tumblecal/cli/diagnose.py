"""`tumblecal diagnose`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING


if TYPE_CHECKING:
    from tumblecal.capture.position_samples import PositionSamples

from tumblecal.cli.options import (
    AllowedAlpha,
    AllowedBeta,
    AllowedMount,
    EffectFiles,
    Fixed,
    NoiseSd,
    Priors,
    RigFile,
    angles,
)


def diagnose(
    data: list[Path],
    /,
    *,
    rig: RigFile = None,
    out: Path = Path("diagnosis"),
    noise_sd: NoiseSd = None,
    samples: Path | None = None,
    prior: Priors = (),
    fix: Fixed = (),
    effects: EffectFiles = (),
    join: bool = False,
    holdout: str | None = None,
    allow_alpha: AllowedAlpha = (),
    allow_beta: AllowedBeta = (),
    allow_mount: AllowedMount = "turns",
    figures: bool | None = None,
) -> int:
    """Find what the model gets wrong in measured positions, and why.

    Parameters
    ----------
    data
        Position files, .csv or .parquet. Several files are diagnosed one by one, each into its own subfolder.
    out
        Folder for diagnosis.json, verdict.txt, calibration.json of the extended model, plans of the next positions, the
        figures and diagnosis.html, which holds all of it; summary.csv where there are several files.
    samples
        The raw samples that the means were made of: the folder of tumblecal capture, or a table (.csv, .parquet) with
        columns position, ax_g, ay_g, az_g, time_s. Their noise, slow parts included, then weighs the positions.
    join
        Take the files as parts of one measurement, such as the first positions and those that were proposed next.
    holdout
        Data kept out of the fit when the gain is measured: run=3, mount=B or position=1-4.
    figures
        Draw the figures (SVG) and write the page; by default only for a single measurement.
    """
    from tumblecal.cli.start import start

    start()
    from tumblecal.cli.model import Model
    from tumblecal.data import read_positions
    from tumblecal.data.atomic import output_folders
    from tumblecal.data.joined import joined
    from tumblecal.diagnosis import Diagnoser
    from tumblecal.diagnosis.next_grid import Allowed
    from tumblecal.diagnosis.verdict import verdict_text
    from tumblecal.errors import InputError
    from tumblecal.report.diagnosis_files import write_diagnosis
    from tumblecal.report.diagnosis_summary import summary_row, write_summary

    model = Model.of(rig, noise_sd, prior, fix, effects)
    kept_out = _holdout(holdout)
    allowed = Allowed(angles("--allow-alpha", allow_alpha), angles("--allow-beta", allow_beta), allow_mount == "turns")
    raw = _samples(samples, data, noise_sd)
    read = [read_positions(file, check_size=False) for file in data]
    if join:
        read, data = [joined(read)], data[:1]
    diagnoser = Diagnoser(model.entries, plan_next=len(read) == 1, nested=len(read) == 1, allowed=allowed)
    folders = _folders(data, out)
    faults: list[str] = []
    rows: list[dict] = []
    with output_folders(folders):
        try:
            for number, (file, folder, positions) in enumerate(zip(data, folders, read, strict=True), start=1):
                count = f"{number} of {len(data)}  {file}"
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
                    rows.append(summary_row(file, error))
                    if len(data) > 1:
                        print(f"{count}: refused", flush=True)
                    continue
                rows.append(summary_row(file, found))
                text = f"{count}: {found.verdict}; {', '.join(found.labels) or 'nothing found'}"
                print(verdict_text(found) if len(data) == 1 else text, flush=True)
                written = write_diagnosis(folder, found, figures=len(data) == 1 if figures is None else figures)
                if len(data) == 1:
                    print(f"written: {folder}/: {', '.join(written)}", flush=True)
        finally:
            # An interrupted batch leaves the lines of what was finished.
            if len(data) > 1:
                write_summary(out / "summary.csv", rows)
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
