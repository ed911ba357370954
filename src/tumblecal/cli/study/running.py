"""Command line of all kinds of study: print the cost, run with a progress bar, write and print results."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.options import Count, Seed, options, within
from tumblecal.cli.result_files import names_written
from tumblecal.cli.terminal import warn
from tumblecal.ground.counted import counted, duration
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.studies.run import Study


# Time to compile the program of a study, s; measured with an empty cache on a busy core (7 to 13 s).
COMPILE_SECONDS = 12.0

Number = Annotated[int | None, within(gte=2, lte=10**12)]
StudySeed = Annotated[
    Seed | None, Parameter(help="Seed of all random numbers. Default: that of the file. Example: --seed 1.")
]


@options
class Running:
    """Execution of a study; these options do not change its result.

    Parameters
    ----------
    out
        Output folder: finished chunks, JSON, Parquet and figures. An interrupted study in this folder is continued.
        Example: --out study1.
    workers
        Number of worker processes on this machine (needs the cluster extra). Default: this process only. Example:
        --workers 4.
    scheduler
        Address of a running dask scheduler. Default: none. Example: --scheduler tcp://10.0.0.5:8786.
    dry_run
        Estimate of trials, chunks, hours and bytes only; no study is run.
    max_hours
        Largest estimated time, h; a longer study is rejected. Example: --max-hours 48.
    max_gib
        Largest estimated disk space, GiB; a larger study is rejected. Example: --max-gib 50.
    """

    out: Path
    workers: Count | None = None
    scheduler: str | None = None
    dry_run: bool = False
    max_hours: float = 24.0
    max_gib: float = 10.0


def run_study(
    kind: str, config: Path, changes: Mapping[str, object | None], running: Running, effects: Sequence[Path] = ()
) -> None:
    """Run one study.

    **Arguments:**

    - `kind`, `config`: kind of study and its file.
    - `changes`: keys of the file that the command line overrides; None for those not given.
    - `running`: execution options. `effects`: Python files with user-defined effects.

    **Raises:** `InputError` for faults of the files, a study that is too large, or a folder of a different study.
    """
    from tumblecal.cli.start import start

    if running.workers is not None and running.scheduler is not None:
        raise InputError("--workers and --scheduler contradict each other; give only one of them")
    # The workers compute on the CPU, so this process computes its share there too.
    start(accelerator=running.workers is None, one_thread=True)
    from rich.console import Console

    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.ground.atomic import writable_folder
    from tumblecal.show.figures.drawing import write_each
    from tumblecal.show.figures.study import FIGURES
    from tumblecal.show.page import write_page
    from tumblecal.show.study import answer_of, print_answer
    from tumblecal.studies.run import run, study_of
    from tumblecal.studies.study_tables import read_study, unused_of_head

    console = Console()
    tables = read_study(config, kind, {name: value for name, value in changes.items() if value is not None}, effects)
    study = study_of(tables)
    if unused := unused_of_head(kind, tables):
        warn(config, [unused])
    if not _affordable(study, config, running):
        return
    names = (f"{kind}*", "*.svg", "manifest.json", "chunks/*")
    protect_inputs([config, config.parent / str(tables["study"]["rig"]), *effects], folders=[running.out], names=names)
    folder = writable_folder(running.out)

    def shown(aside: Path, content, frames) -> None:
        answer, drawn = answer_of(kind, content, frames), write_each(aside, FIGURES[kind], content, frames)
        write_page(aside / f"{kind}.html", answer.words, drawn, tables={"results": answer.table})

    try:
        with _workers(tables, running) as computed, _bar(console, study.trials) as progress:
            content, frames = run(
                tables, folder, study=study, computed=computed, progress=progress, tell=print, shown=shown
            )
    except KeyboardInterrupt:
        words = f"{folder}: the finished chunks are stored; the same command continues from there"
        raise KeyboardInterrupt(words) from None
    print_answer(answer_of(kind, content, frames), console)
    written = names_written(folder, (f"{kind}.html", "*.svg", f"{kind}_*.parquet", f"{kind}.json"))
    print(f"{written} (open {folder / kind}.html)")


def _affordable(study: "Study", config: Path, running: Running) -> bool:
    """Print the estimated cost of a study; whether it is to run.

    **Raises:** `InputError` for a study beyond the limits.
    """
    workers = running.workers or 1
    compiling, computing = COMPILE_SECONDS * study.programs, study.seconds / workers
    hours, gib = (compiling + computing) / 3600, study.chunks * study.chunk_bytes / 2**30
    print(
        f"{config}: {counted(study.trials, 'trial')} in {counted(study.chunks, 'chunk')}; about {duration(computing)} on "
        f"{counted(workers, 'core')}, plus about {duration(compiling)} to compile it the first time; {gib:.2g} GiB on disk"
    )
    for needed, most, option in ((hours, running.max_hours, "max-hours"), (gib, running.max_gib, "max-gib")):
        if needed > most:
            raise InputError(
                f"{config}: {option.partition('-')[2]}: would need {needed:.3g}, more than --{option} {most:g}"
            )
    return not running.dry_run


def _workers(tables, running: Running):
    if running.workers is None and running.scheduler is None:
        return nullcontext(None)
    from tumblecal.studies.cluster import cluster

    return cluster(tables, workers=running.workers, scheduler=running.scheduler)


@contextmanager
def _bar(console, trials: int) -> Iterator[Callable[[int], None]]:
    """A progress bar with remaining time."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

    columns = BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=not console.is_terminal) as progress:
        task = progress.add_task("trials", total=trials)
        yield partial(progress.advance, task)
