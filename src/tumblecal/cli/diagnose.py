"""`tumblecal diagnose`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tumblecal.cli.command import Command
from tumblecal.cli.diagnosis_batch import DIAGNOSIS_SET, Batch
from tumblecal.cli.options import Count, ModelOptions, NextPositions, ResultOptions, options, within
from tumblecal.cli.position_files import ONE_MOUNTING, JoinOptions, PositionFiles
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.cli.position_files import Read


# Files for all units together.
_UNITS_SET = ("diagnosis.json", "verdict.txt", "head.toml", "diagnosis.html", "shared_by_unit.svg")


@options
class InputOptions:
    """Relation of the files to each other, and to raw samples.

    Parameters
    ----------
    samples
        Raw samples of the position means: folder of tumblecal capture, or table (.csv, .parquet) with columns position,
        ax_g, ay_g, az_g, time_s. Their noise, including its slow part, weights the positions. With --join: one table for
        all files. Default: none. Example: --samples run1.
    units
        Files of different units (triads), measured on one dividing head: separates errors of the head from those of each
        sensor, and writes head.toml for --head. Example: diagnose A1.csv A2.csv --units.
    holdout
        Data held out of the fit to measure the improvement: a run, a mounting or positions. Default: each run, or
        each position, in turn. Example: --holdout run=3.
    workers
        Number of worker processes for a batch. Default: one for every 40 files, at most one for each core. Example:
        --workers 2.
    max_rows
        Largest number of positions used without averaging. If there are more, repeats are averaged; more than 1000 after
        averaging are rejected with an estimate of the cost, unless this option allows them. Default: 400. Example:
        --max-rows 2000.
    """

    samples: Path | None = None
    units: bool = False
    holdout: str | None = None
    workers: Count | None = None
    max_rows: Annotated[int | None, within(gte=3)] = None


def diagnose(
    data: list[Path],
    /,
    *,
    model: ModelOptions = ModelOptions(),
    out: Path = Path("diagnosis"),
    inputs: InputOptions = InputOptions(),
    joining: JoinOptions = JoinOptions(),
    following: NextPositions = NextPositions(),
    more: ResultOptions = ResultOptions(),
    command: Command = Command(),
) -> int:
    """Find the errors of the model in measured positions, and their causes.

    Parameters
    ----------
    data
        Position files (.csv or .parquet). Several files are a batch: each is diagnosed separately, in a subfolder.
    out
        Output folder: diagnosis.json, verdict.txt, calibration.json of the extended model, plans of the next positions,
        figures, diagnosis.html (all results) and, for a batch, summary.csv. A folder with results of calibrate is rejected.
        Example: --out unit17.
    """
    command.begin(one_thread=True)
    from tumblecal.data.overwriting import DIAGNOSIS
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.option_texts import angles, pairs
    from tumblecal.lab.summary import DIAGNOSED
    from tumblecal.planning import Allowed
    from tumblecal.recordings.dwells.position_samples import read_position_samples

    files = PositionFiles(command, joining, more, data, out)
    if inputs.units and (joining.join or model.head is not None):
        raise InputError(
            "--units treats each file as a different triad on a head of unknown errors; give it without --join and --head"
        )
    if inputs.units and len(data) < 2:
        raise InputError("--units: only one file; give the files of at least two units to find their common errors")
    held_out = next(iter(pairs("--holdout", [inputs.holdout or ""], "run=3").items()), None)
    if inputs.samples is not None and model.noise_sd is not None:
        raise InputError("--samples and --noise-sd both state the noise; give only one of these options")
    if inputs.samples is not None and not files.single:
        raise InputError("--samples is for one position file, but several are given; diagnose each file separately")
    raw = None if inputs.samples is None else read_position_samples(inputs.samples)
    alpha, beta = angles("--allow-alpha", following.allow_alpha), angles("--allow-beta", following.allow_beta)
    allowed = Allowed(alpha or None, beta or None, following.allow_mount == "turns")
    batch = Batch(model, held_out, raw, allowed, files.single, more, inputs.max_rows, command)
    names = (*DIAGNOSIS_SET, *_UNITS_SET)
    read = files.read(batch.model, model, DIAGNOSIS, names, inputs.samples, together=inputs.units, check_size=False)
    if joining.join and len(data) > 1 and not isinstance(read[0], InputError) and read[0].mount is None:
        batch.note = ONE_MOUNTING
    with output_folders(files.folders, out):
        if inputs.units:
            return _diagnose_units(files, batch, read, inputs.workers)
        outcomes = batch.run(files.files, files.folders, read, inputs.workers)
        return files.conclude(outcomes, DIAGNOSED, DIAGNOSIS_SET, "diagnosis.json", "diagnosing")


def _diagnose_units(files: PositionFiles, batch: Batch, read: "list[Read]", workers: int | None) -> int:
    """Screen each unit, estimate common errors, diagnose each unit given these, and write all results.

    **Raises:** `InputError` with the faults of all files.
    """
    from tumblecal.diagnosis.units import joint_diagnosis
    from tumblecal.ground.result_set import remove_results, result_set
    from tumblecal.lab.summary import DIAGNOSED
    from tumblecal.show.units_together import words_of_units, write_units
    from tumblecal.show.verdict import verdict_lines

    screened = {}
    with batch.command.working(f"screening {len(read)} units"):
        for number, positions in enumerate(read):
            try:
                screened[number] = batch.screened(positions)
            except InputError as fault:
                read[number] = fault
    if len(screened) < 2:
        faults = [fault for part in read if isinstance(part, InputError) for fault in part.faults]
        raise InputError([*faults, "--units: fewer than two units can be diagnosed; common errors need at least two"])
    with batch.command.working("estimating errors common to the units"):
        measured = joint_diagnosis([*screened.values()], [str(files.files[k]) for k in screened], batch.model.usual)
    heads = {number: measured.known_to(place) for place, number in enumerate(screened)}
    del screened

    def write(rows: Sequence[dict[str, Any]]) -> None:
        units = [(files.folders[number].name, rows[number]) for number in heads]
        words, figures = words_of_units(measured, units, batch.model.entries), batch.more.figures is not False
        with result_set(files.out, _UNITS_SET) as aside:
            write_units(aside, measured, units, batch.model.entries, words, figures=figures)
        batch.command.say(*verdict_lines(words.verdict, batch.command.columns))
        batch.command.end(files.out, _UNITS_SET, "diagnosis.json")

    # They describe the results of the units before the first one is replaced.
    remove_results(files.out, _UNITS_SET)
    outcomes = batch.run(files.files, files.folders, read, workers, [heads.get(k) for k in range(len(read))])
    return files.conclude(outcomes, DIAGNOSED, DIAGNOSIS_SET, "", "diagnosing", write)
