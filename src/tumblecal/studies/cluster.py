"""Chunks computed by the workers of `dask.distributed`: started here, or those of a running cluster."""

import json
import logging
import os
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from typing import Any, TypeAlias

import numpy as np

from tumblecal.ground.errors import InputError
from tumblecal.ground.program_cache import keep_programs_in, program_cache
from tumblecal.studies.chunk import NotThisChunk, differences, maker, packed, statement, study_hash, unpacked
from tumblecal.studies.run import Check, Computed, Elsewhere, compute_chunk
from tumblecal.studies.threads import ONE_THREAD, use_one_thread
from tumblecal.studies.verification import Distrusted
from tumblecal.studies.worker_watch import WorkerWatch


ComputeChunk: TypeAlias = Callable[[str, int], dict[str, np.ndarray]]

# Tries of a chunk before it is given up: a worker may die under it that many times.
TRIES = 10
# Chunks in progress for each worker: enough that none waits, few enough that little is lost or stored.
AHEAD = 2
# Seconds without a worker, or without the scheduler, before a study gives up; a worker that died is back sooner.
PATIENCE = 15.0
# The interface that processes started here listen on; what they are sent they run.
LOOPBACK = "127.0.0.1"
WORKER_ENVIRONMENT = ONE_THREAD | {"JAX_PLATFORMS": "cpu"}
# Evaluated by workers, whatever they have installed.
_MAKER = "__import__('tumblecal.studies.cluster', fromlist=['worker_maker']).worker_maker()"


@contextmanager
def cluster(
    tables: Mapping[str, Any],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    compute: ComputeChunk = compute_chunk,
) -> Iterator[Elsewhere]:
    """Workers for a study, as the `computed` of `run.run`.

    **Arguments:**

    - `tables`: from `read_study`.
    - `workers`: number of worker processes to start on this machine, or
    - `scheduler`: address of a running scheduler, such as `tcp://10.0.0.5:8786`.
    - `compute`: what a worker runs, from the tables as JSON and a chunk's number; a function that can be imported.

    **Raises:** `InputError` when dask is not installed, the scheduler cannot be reached or dies, there are no workers, or
    one of them is not as this process: other versions, another device.
    """
    try:
        import distributed
    except ImportError as error:
        raise InputError(
            "workers need dask.distributed: install tumblecal[cluster], or leave out --workers and --scheduler"
        ) from error
    # Lost connections and failed tasks are reported in one line here instead of dask's messages.
    for name in ("client", "core", "scheduler", "nanny", "comm", "batched", "protocol.pickle"):
        logging.getLogger(f"distributed.{name}").setLevel(logging.CRITICAL)
    if scheduler is None:
        with _local(workers or 1) as local, distributed.Client(local) as client:
            if cache := program_cache():
                client.run(keep_programs_in, cache.folder)
            yield _Cluster(client, "--workers", compute, tables).gathered
        return
    try:
        client = distributed.Client(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {scheduler}: no scheduler answers there ({error})") from error
    try:
        yield _Cluster(client, f"--scheduler {scheduler}", compute, tables).gathered
    finally:
        client.close(timeout=2)


def _local(workers: int):
    """Worker processes on this machine; those that die are started again."""
    import distributed
    from dask.config import set as configure

    environment = {name: os.environ.get(name, value) for name, value in WORKER_ENVIRONMENT.items()}
    configure({"distributed.scheduler.allowed-failures": TRIES})
    # The variables must be there before the worker imports JAX.
    configure({"distributed.nanny.pre-spawn-environ": environment})
    options: dict[str, Any] = {"host": LOOPBACK, "dashboard_address": None, "memory_limit": 0, "processes": True}
    return distributed.LocalCluster(n_workers=workers, threads_per_worker=1, **options)


class _Cluster:
    """A study's chunks from the workers of a client; `name` is what the user called them."""

    def __init__(self, client, name: str, compute: ComputeChunk, tables: Mapping[str, Any]):
        self._client, self._name, self._compute = client, name, compute
        self._text, self._study = json.dumps(dict(tables)), study_hash(tables)

    def gathered(
        self,
        missing: list[int],
        /,
        check: Check = lambda chunk, arrays: None,
        tell: Callable[[str], object] = lambda line: None,
    ) -> Computed:
        """Hand out chunks a few at a time; yield them as they come, each checked to be as if made here.

        **Raises:** `Distrusted` for a chunk that is not as wanted; `InputError` when scheduler or workers are gone.
        """
        waiting, under_way = list(reversed(missing)), {}
        watch = WorkerWatch(self._name, tell)
        try:
            if waiting:
                self._compare_workers()
            while waiting or under_way:
                while waiting and len(under_way) < AHEAD * max(1, len(self._workers())):
                    chunk = waiting.pop()
                    task = self._client.submit(_stated, self._compute, self._text, chunk, pure=False, retries=TRIES)
                    under_way[task] = chunk
                for task in self._ended(list(under_way), watch):
                    chunk = under_way.pop(task)
                    yield chunk, *self._content(task, chunk, check)
        except (CancelledError, OSError) as error:
            raise InputError(
                f"{self._name}: the scheduler is gone; finished chunks are stored; run the same command again to resume"
            ) from error

    def _workers(self) -> dict[str, Any]:
        return dict(self._client.scheduler_info(n_workers=-1)["workers"])

    def _ended(self, tasks: list, watch: WorkerWatch) -> list:
        """The tasks that ended; waits for one, and meanwhile watches the workers."""
        from distributed import wait

        last_seen = time.monotonic()
        while True:
            with suppress(TimeoutError):
                wait(tasks, timeout=1, return_when="FIRST_COMPLETED")
            workers = self._workers()
            watch.look(workers)
            if ended := [task for task in tasks if task.status != "pending"]:
                return ended
            if workers:
                last_seen = time.monotonic()
            elif time.monotonic() - last_seen > PATIENCE:
                raise self._no_workers()

    def _no_workers(self) -> InputError:
        return InputError(
            f"{self._name}: no worker is connected for {PATIENCE:.0f} s; start some (dask worker ADDRESS), or use --workers"
        )

    def _compare_workers(self) -> None:
        """Refuse workers that are not as this process; one that ends meanwhile is none."""
        from distributed.comm.core import CommClosedError

        with suppress(TimeoutError):
            self._client.wait_for_workers(1, timeout=PATIENCE)
        if not self._workers():
            raise self._no_workers()
        faults = []
        for address, answer in self._client.run(eval, _MAKER, on_error="return").items():
            if isinstance(answer, Mapping):
                fault = ", ".join(differences(answer, maker()))
            elif isinstance(answer, ModuleNotFoundError) and answer.name == "tumblecal":
                fault = "it has no tumblecal"
            elif isinstance(answer, CommClosedError):
                continue
            else:
                fault = f"it has another tumblecal ({type(answer).__name__}: {answer})"
            if fault:
                faults.append(self._refused(address, fault))
        if faults:
            raise InputError(faults)

    def _refused(self, worker: str, fault: str) -> str:
        return f"{self._name}: worker {worker} rejected: {fault}; a study needs the same versions and device everywhere"

    def _content(self, task, chunk: int, check: Check) -> tuple[bytes, str]:
        """The bytes of a chunk and the worker that computed it."""
        from distributed import KilledWorker

        failure = task.exception()
        if failure is not None:
            # A worker without this tumblecal cannot even read its task.
            self._compare_workers()
        if isinstance(failure, RuntimeError) and isinstance(failure.__cause__, ImportError | AttributeError):
            raise InputError(f"{self._name}: the scheduler needs tumblecal as its workers do ({failure.__cause__})")
        if isinstance(failure, KilledWorker):
            raise InputError(f"{self._name}: chunk {chunk}: {failure.allowed_failures + 1} workers died under it")
        content = task.result()
        holders = [address for addresses in self._client.who_has([task]).values() for address in addresses]
        worker = ", ".join(holders) or "(gone)"
        try:
            if not isinstance(content, bytes):
                raise NotThisChunk("it does not state its origin")
            arrays = unpacked(content, statement(self._study, chunk))
        except NotThisChunk as error:
            raise Distrusted(worker, self._refused(worker, f"chunk {chunk}: {error}")) from error
        try:
            check(chunk, arrays)
        except NotThisChunk as error:
            fault = f"{self._name}: worker {worker} rejected: chunk {chunk}: {error}; its results are discarded"
            raise Distrusted(worker, fault) from error
        return content, worker


def worker_maker() -> dict[str, Any]:
    """What the worker that runs this is: `chunk.maker`."""
    use_one_thread()
    return maker()


def _stated(compute: ComputeChunk, text: str, chunk: int) -> bytes:
    """What a worker runs for a chunk."""
    use_one_thread()
    arrays = compute(text, chunk)
    return packed(statement(study_hash(json.loads(text)), chunk), arrays)
