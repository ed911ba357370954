"""Command line of all kinds of study: print the cost, run with a progress bar, write and print results."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.ground.counted import counted


if TYPE_CHECKING:
    from tumblecal.studies.run import Study


# Time to compile the program of a study, s; measured with an empty cache on a busy core (7 to 13 s).
COMPILE_SECONDS = 12.0

Seed = Annotated[
    int | None, Parameter(help="Seed of all random numbers. Default: that of the file. Example: --seed 1.")
]


@Parameter(name="*")
@dataclass(frozen=True)
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
    workers: Annotated[int | None, Parameter(name="--workers")] = None
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
    from tumblecal.ground.errors import InputError
    from tumblecal.studies.threads import use_one_thread

    if running.workers is not None and running.workers < 1:
        raise InputError(f"--workers {running.workers}: at least 1; remove it to compute in this process")
    if running.workers is not None and running.scheduler is not None:
        raise InputError("--workers and --scheduler contradict each other; give only one of them")
    use_one_thread()
    # The workers compute on the CPU, so this process computes its share there too.
    start(accelerator=running.workers is None)
    from rich.console import Console

    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.ground.atomic import writable_folder
    from tumblecal.report.study_answers import answer_of, print_answer
    from tumblecal.report.study_page import write_study_page
    from tumblecal.show.figures.drawing import write_each
    from tumblecal.show.figures.study import FIGURES
    from tumblecal.studies.run import run, study_of
    from tumblecal.studies.study_tables import read_study, unused_of_head

    console = Console()
    tables = read_study(config, kind, {name: value for name, value in changes.items() if value is not None}, effects)
    study = study_of(tables)
    if unused := unused_of_head(kind, tables):
        print(f"WARNING: {unused}", file=sys.stderr)
    cost, too_much = _cost(study, config, running)
    console.print(cost, highlight=False)
    if too_much:
        raise InputError(too_much)
    if running.dry_run:
        return
    rig = config.parent / str(tables["study"]["rig"])
    protect_inputs(
        [config, rig, *effects], folders=[running.out], names=(f"{kind}*", "*.svg", "manifest.json", "chunks/*")
    )
    folder = writable_folder(running.out)
    report = partial(console.print, highlight=False, markup=False, soft_wrap=True)
    written = list[str]()

    def shown(aside: Path, content, frames) -> None:
        figures = write_each(aside, FIGURES[kind], content, frames)
        page = write_study_page(
            aside / f"{kind}.html", kind, content, frames, answer_of(kind, content, frames), figures
        )
        tables = [f"{kind}_{name}.parquet" for name in frames]
        written.extend([*page, *figures, *tables, f"{kind}.json"])

    with _resumable(folder), _workers(tables, running) as computed, _bar(console, study.trials) as progress:
        content, frames = run(
            tables, folder, study=study, computed=computed, progress=progress, tell=report, shown=shown
        )
    print_answer(answer_of(kind, content, frames), console)
    report(f"written: {folder}/: {', '.join(written)} (open {folder / written[0]})")


def _cost(study: "Study", config: Path, running: Running) -> tuple[str, list[str]]:
    """The estimated cost of a study in words, and the limits that it exceeds."""
    workers = running.workers or 1
    compiling = COMPILE_SECONDS * study.programs / 3600
    hours, gib = study.seconds / 3600 / workers, study.chunks * study.chunk_bytes / 2**30
    words = (
        f"{config}: {counted(study.trials, 'trial')} in {counted(study.chunks, 'chunk')}; about {_time(hours)} on {workers} "
        f"core{'s' if workers > 1 else ''}, plus about {_time(compiling)} to compile it the first time; "
        f"{_bytes(gib)} on disk"
    )
    hours += compiling
    too_much = []
    if hours > running.max_hours:
        too_much.append(f"{config}: would take {hours:.1f} h, more than --max-hours {running.max_hours:g}")
    if gib > running.max_gib:
        too_much.append(f"{config}: would need {gib:.1f} GiB of disk, more than --max-gib {running.max_gib:g}")
    return words, too_much


@contextmanager
def _resumable(folder: Path) -> Iterator[None]:
    """Report, if a study is interrupted, that its finished chunks are stored."""
    try:
        yield
    except KeyboardInterrupt:
        words = f"{folder}: the finished chunks are stored; the same command continues from there"
        raise KeyboardInterrupt(words) from None


def _workers(tables, running: Running):
    if running.workers is None and running.scheduler is None:
        return nullcontext(None)
    from tumblecal.studies.cluster import cluster

    return cluster(tables, workers=running.workers, scheduler=running.scheduler)


class _bar:
    """A progress bar with rate and remaining time; chunks of an earlier call do not count for the rate."""

    def __init__(self, console, trials: int):
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[rate]}"), TimeElapsedColumn())
        self._progress = Progress(*columns, console=console, transient=not console.is_terminal)
        self._trials = trials

    def __enter__(self):
        import time

        self._progress.start()
        task = self._progress.add_task("trials", total=self._trials, rate="")
        # The rate does not include the first chunk of this call, which is compiled.
        begin, done, calls, counted = time.monotonic(), 0, 0, 0

        def advance(trials: int) -> None:
            nonlocal begin, done, calls, counted
            done, calls = done + trials, calls + 1
            if calls == 1 or (calls == 2 and done < self._trials):
                begin, counted = time.monotonic(), done
            rate = (done - counted) / max(time.monotonic() - begin, 1e-9)
            remaining = f", {_time((self._trials - done) / rate / 3600)} left" if rate > 0 else ""
            self._progress.update(task, completed=done, rate=f"{rate:,.0f}/s{remaining}")

        return advance

    def __exit__(self, *_):
        self._progress.stop()


def _time(hours: float) -> str:
    if hours < 1 / 60:
        return f"{3600 * hours:.0f} s"
    return f"{60 * hours:.0f} min" if hours < 2 else f"{hours:.1f} h"


def _bytes(gib: float) -> str:
    return f"{gib:.1f} GiB" if gib >= 1 else f"{max(1024 * gib, 0.1):.1f} MiB"
