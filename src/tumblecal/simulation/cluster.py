"""Chunks computed by the workers of `dask.distributed`: started here, or those of a running cluster."""

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeAlias

import numpy as np

from tumblecal.errors import InputError
from tumblecal.program_cache import keep_programs, program_cache
from tumblecal.simulation.run import Computed, compute_chunk


ComputeChunk: TypeAlias = Callable[[str, int], dict[str, np.ndarray]]

# Tries of a chunk before it is given up: a worker may die under it that many times.
TRIES = 10
# Chunks handed out at a time, for each worker: enough that none waits, few enough that little is lost or held.
AHEAD = 2
# One thread for each worker: processes share the cores, and XLA's own threads would only compete for them.
WORKER_ENVIRONMENT = {
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    "NPROC": "1",
    "OMP_NUM_THREADS": "1",
    "JAX_PLATFORMS": "cpu",
}


@contextmanager
def cluster(
    tables: Mapping[str, Any],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    compute: ComputeChunk = compute_chunk,
) -> Iterator[Callable[[list[int]], Computed]]:
    """Workers for a study, as the `computed` of `run.run`.

    **Arguments:**

    - `tables`: from `read_study`.
    - `workers`: number of worker processes to start on this machine, or
    - `scheduler`: address of a running scheduler, such as `tcp://10.0.0.5:8786`.
    - `compute`: what a worker runs, from the tables as JSON and a chunk's number; a function that can be imported.

    **Raises:** `InputError` when dask is not installed or the scheduler cannot be reached.
    """
    try:
        import distributed
    except ImportError as error:
        raise InputError(
            "workers need dask.distributed: install tumblecal[cluster], or leave out --workers and --scheduler"
        ) from error
    text = json.dumps(dict(tables))
    if scheduler is not None:
        try:
            client = distributed.Client(scheduler, timeout=10)
        except (OSError, ValueError) as error:
            raise InputError(f"--scheduler {scheduler}: no scheduler answers there ({error})") from error
        with client:
            yield lambda missing: _gathered(client, compute, text, missing)
        return
    local = _local(workers or 1)
    with local, distributed.Client(local) as client:
        if cache := program_cache():
            client.run(keep_programs, cache.folder)
        yield lambda missing: _gathered(client, compute, text, missing)


def _local(workers: int):
    """Worker processes on this machine; those that die are started again."""
    import distributed
    from dask.config import set as configure

    environment = {name: os.environ.get(name, value) for name, value in WORKER_ENVIRONMENT.items()}
    configure({"distributed.scheduler.allowed-failures": TRIES})
    # The variables must be there before the worker imports JAX.
    configure({"distributed.nanny.pre-spawn-environ": environment})
    options: dict[str, Any] = {"dashboard_address": None, "memory_limit": 0, "processes": True}
    return distributed.LocalCluster(n_workers=workers, threads_per_worker=1, **options)


def _gathered(client, compute: ComputeChunk, text: str, missing: list[int]) -> Computed:
    """Hand out chunks a few at a time; yield them as they come."""
    import distributed

    waiting = list(reversed(missing))

    def submitted():
        chunk = waiting.pop()
        return client.submit(_numbered, compute, text, chunk, pure=False, retries=TRIES)

    ahead = AHEAD * max(1, len(client.scheduler_info()["workers"]))
    under_way = distributed.as_completed([submitted() for _ in range(min(ahead, len(waiting)))])
    for future in under_way:
        yield future.result()
        if waiting:
            under_way.add(submitted())


def _numbered(compute: ComputeChunk, text: str, chunk: int):
    return chunk, compute(text, chunk)
