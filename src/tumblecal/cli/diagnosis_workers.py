"""The position files of `tumblecal diagnose` in this process or in worker processes."""

import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.diagnosis_batch import Batch
from tumblecal.cli.outcomes import Outcome
from tumblecal.cli.position_files import PositionFiles


if TYPE_CHECKING:
    from tumblecal.chain.head_file import MeasuredHead
    from tumblecal.cli.positions_read import Read

# Starting a worker process takes as long as the diagnosis of so many files.
_FILES_A_PROCESS = 40
_batch: Batch | None = None


def diagnosed_files(
    batch: Batch,
    files: PositionFiles,
    read: "Sequence[Read]",
    workers: int | None,
    heads: "Sequence[MeasuredHead | None]",
) -> Iterator[Outcome]:
    """The outcome of each file, in order, when it is ready; `heads`: measured errors of the head for each file."""
    from tumblecal.cli.diagnosed_file import diagnosed_file

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    workers = max(1, min(cores, len(read) // _FILES_A_PROCESS)) if workers is None else workers
    if workers == 1 or len(read) == 1:
        yield from map(partial(diagnosed_file, batch), files.files, files.folders, read, heads)
        return
    # Without the model and the diagnoser, which each process prepares.
    pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_work, initargs=(replace(batch),))
    try:
        yield from pool.map(_diagnosed, files.files, files.folders, read, heads)
    finally:
        pool.shutdown(cancel_futures=True)


def _work(batch: Batch) -> None:
    """Prepare a worker process; interrupts are handled by the parent process."""
    global _batch
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from tumblecal.cli.run import warn_in_one_line
    from tumblecal.cli.start import start

    warn_in_one_line()
    start(one_thread=True)
    _batch = batch


def _diagnosed(file: Path, folder: Path, positions: "Read", head: "MeasuredHead | None") -> Outcome:
    from tumblecal.cli.diagnosed_file import diagnosed_file

    assert _batch is not None
    return diagnosed_file(_batch, file, folder, positions, head)
