"""The processes that compute a study, and its progress on the terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial

from tumblecal.cli.commands.study.study_options import Running


def workers_of(tables, running: Running):
    """The worker processes of a study; None if it is computed in this process."""
    if running.workers is None and running.scheduler is None:
        return nullcontext(None)
    from tumblecal.studies.cluster import cluster

    return cluster(tables, workers=running.workers, scheduler=running.scheduler)


@contextmanager
def progress_bar(console, trials: int) -> Iterator[Callable[[int], None]]:
    """A progress bar with remaining time."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

    columns = BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=not console.is_terminal) as progress:
        task = progress.add_task("trials", total=trials)
        yield partial(progress.advance, task)
