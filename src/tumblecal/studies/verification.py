"""Checks of chunks before they are summed: their number of trials, and one recomputed chunk of each worker."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.studies.chunk import NotThisChunk, study_hash
from tumblecal.studies.store import Store


class Countable(Protocol):
    """A study whose chunks state their number of trials."""

    def trials_of(self, chunk: int) -> int:
        """Trials that are wanted in a chunk."""
        ...

    def trials_in(self, arrays: Mapping[str, np.ndarray]) -> float:
        """Trials that a chunk's own arrays count."""
        ...

    def compute(self, chunk: int) -> dict[str, np.ndarray]:
        """One chunk."""
        ...


class Distrusted(InputError):
    """A worker returned a wrong chunk; all its results are discarded."""

    def __init__(self, worker: str, fault: str):
        self.worker = worker
        super().__init__(fault)


def check_counts(study: Countable, chunk: int, arrays: Mapping[str, np.ndarray]) -> None:
    """Compare the trials that a chunk counts with those that were requested.

    **Raises:** `NotThisChunk`.
    """
    wanted = study.trials_of(chunk)
    try:
        found = float(study.trials_in(arrays))
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise NotThisChunk("it does not count its trials") from error
    if found != wanted:
        raise NotThisChunk(f"it counts {found:.10g} trials, {wanted} were requested")


def recheck_workers(study: Countable, tables: Mapping[str, Any], store: Store) -> None:
    """Compute one chunk of each worker again in this process and compare it bit for bit.

    The chunk is drawn with a seed that follows from the study and the worker's chunks. A worker that passes is forgotten.

    **Raises:** `Distrusted` for a worker whose chunk is not the same.
    """
    for worker, chunks in sorted(store.unverified().items()):
        digest = int(study_hash(tables)[:16], 16)
        chunk = chunks[int(np.random.default_rng([digest, *chunks]).integers(len(chunks)))]
        mine, theirs = study.compute(chunk), store.chunk(chunk)
        different = sorted(
            name for name in mine.keys() | theirs.keys() if not _same_bits(mine.get(name), theirs.get(name))
        )
        if different:
            raise Distrusted(
                worker,
                f"worker {worker}: chunk {chunk}, computed again in this process, has other numbers ({', '.join(different)}); "
                f"{counted(len(chunks), 'chunk')} of this worker removed. Give the same command again without that worker",
            )
    store.forget_workers()


def _same_bits(mine: np.ndarray | None, theirs: np.ndarray | None) -> bool:
    if mine is None or theirs is None:
        return False
    mine, theirs = np.asarray(mine), np.asarray(theirs)
    return mine.shape == theirs.shape and mine.dtype == theirs.dtype and mine.tobytes() == theirs.tobytes()
