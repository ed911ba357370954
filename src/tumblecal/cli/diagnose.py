"""`tumblecal diagnose`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.diagnosis_batch import Batch, processes_for
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


if TYPE_CHECKING:
    from tumblecal.capture.position_samples import PositionSamples


# Said of joined files without a column mount, where something was found.
_ONE_MOUNTING = (
    "The files count as one mounting: if the triad was taken out of its fixture between them, say so in a column mount "
    "(such as A and B)."
)

# What is in the folders of results, of one file or several.
_WRITTEN = ("diagnosis.*", "verdict.txt", "calibration.json", "next_*.toml", "*.svg", "summary.csv")


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
    workers: int | None = None,
    max_rows: int | None = None,
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
        columns position, ax_g, ay_g, az_g, time_s. Their noise, slow parts included, then weighs the positions. With
        --join the table holds the samples of all files.
    join
        Take the files as parts of one measurement, such as the first positions and those that were proposed next.
    holdout
        Data kept out of the fit when the gain is measured: run=3, mount=B or position=1-4.
    figures
        Draw the figures (SVG) and write the page; by default only for a single measurement.
    workers
        Processes that share several files; by default one for every 40 files, at most one a core.
    max_rows
        Positions that are taken one by one, by default 400. Of more, repeats are averaged; what cannot be averaged is
        refused above 1000 with what it would cost, and done where this allows it.
    """
    from tumblecal.cli.start import start

    start()
    from tumblecal.data import read_positions
    from tumblecal.data.atomic import output_folders
    from tumblecal.data.joined import joined
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.errors import InputError
    from tumblecal.estimation.mountings import told_apart
    from tumblecal.planning import Allowed
    from tumblecal.report.diagnosis_summary import write_summary

    if workers is not None and workers < 1:
        raise InputError(f"--workers {workers}: at least 1")
    if max_rows is not None and max_rows < 3:
        raise InputError(f"--max-rows {max_rows}: at least 3")
    kept_out = _holdout(holdout)
    allowed = Allowed(angles("--allow-alpha", allow_alpha), angles("--allow-beta", allow_beta), allow_mount == "turns")
    raw = _samples(samples, data, noise_sd, join)
    one = join or len(data) == 1
    batch = Batch(
        (rig, noise_sd, prior, fix, effects), kept_out, raw, allowed, one, one if figures is None else figures, max_rows
    )
    batch.ready()
    read = [read_positions(file, check_size=False) for file in data]
    given = data
    if join:
        whole = joined(read if rig else told_apart(read))
        batch.note = _ONE_MOUNTING if len(read) > 1 and whole.mount is None else ""
        read, data = [whole], data[:1]
    folders = _folders(data, out)
    inputs_kept([*given, rig, samples, *effects], folders=[*folders, out], names=_WRITTEN)
    faults: list[str] = []
    rows: list[dict] = []
    with output_folders(folders):
        try:
            processes = processes_for(len(read)) if workers is None else workers
            for number, (row, refused, text) in enumerate(batch.run(data, folders, read, processes), start=1):
                rows.append(row)
                faults += refused
                if text:
                    print(text if one else f"{number} of {len(data)}  {text}", flush=True)
        finally:
            # An interrupted batch leaves the lines of what was finished.
            if not one:
                write_summary(out / "summary.csv", rows)
        if faults:
            raise InputError(faults)
    return 0


def _samples(path: Path | None, data: Sequence[Path], noise_sd: str | None, join: bool) -> "PositionSamples | None":
    """The raw samples, where given.

    **Raises:** `InputError` when they cannot be those of the data, or the noise is stated a second time.
    """
    from tumblecal.errors import InputError

    if path is None:
        return None
    if noise_sd is not None:
        raise InputError("--samples and --noise-sd both say how large the noise is; give one of them")
    if len(data) > 1 and not join:
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
