"""Running a study: missing chunks computed here or by workers, stored, then summed up in their order."""

import json
import logging
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from functools import lru_cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import polars as pl

from tumblecal.ground.atomic import write_text, written_aside
from tumblecal.ground.record import ResultRecord
from tumblecal.ground.result_set import result_set
from tumblecal.studies.chunk import packed, statement, study_hash
from tumblecal.studies.injected_units import injected_units
from tumblecal.studies.store import Store
from tumblecal.studies.study_record import StudyHead
from tumblecal.studies.verification import Distrusted, check_counts, recheck_workers


class Study(Protocol):
    """The interface of a kind of study.

    - `trials`: of all chunks. `chunk_bytes`: size of a finished chunk on disk, `seconds`: time on one core, about.
    - `programs`: how many are compiled for it.
    """

    trials: int
    chunks: int
    chunk_bytes: int
    seconds: float
    programs: int

    def trials_of(self, chunk: int) -> int:
        """Trials in a chunk."""
        ...

    def trials_in(self, arrays: Mapping[str, np.ndarray]) -> float:
        """Trials that a chunk's own arrays count."""
        ...

    def compute(self, chunk: int) -> dict[str, np.ndarray]:
        """One chunk."""
        ...

    def summary(self, chunks) -> tuple[ResultRecord, dict[str, pl.DataFrame]]:
        """The result from all chunks."""
        ...


def study_of(study: Mapping[str, Any]) -> Study:
    """The study that tables from `read_study` describe; each kind has the module of its name, with the class of its name."""
    kind = study["kind"]
    return getattr(import_module(f"tumblecal.studies.{kind}"), kind.capitalize())(study)


@lru_cache(maxsize=2)
def _study_from_text(text: str) -> Study:
    return study_of(json.loads(text))


def compute_chunk(text: str, chunk: int) -> dict[str, np.ndarray]:
    """One chunk of the study whose tables are given as JSON: what a worker runs. The program is made once a process."""
    from tumblecal.ground.precision import enable_float64

    enable_float64()
    return _study_from_text(text).compute(chunk)


Content = dict[str, Any]
Frames = dict[str, pl.DataFrame]
# Numbers of chunks, their bytes by `chunk.packed`, and the worker that computed them; None for this process.
Computed = Iterator[tuple[int, bytes, str | None]]
# Raises `NotThisChunk` for arrays that cannot be those of a chunk.
Check = Callable[[int, Mapping[str, np.ndarray]], None]


class Elsewhere(Protocol):
    """Computes the missing chunks in any order, checks each, and reports lines by `tell`."""

    def __call__(self, missing: list[int], /, check: Check, tell: Callable[[str], object]) -> Computed:
        """The chunks as they come."""
        ...


def in_this_process(study: Study, tables: Mapping[str, Any], missing: list[int]) -> Computed:
    """Compute chunks in this process."""
    digest = study_hash(tables)
    for chunk in missing:
        yield chunk, packed(statement(digest, chunk), study.compute(chunk)), None


def run(
    tables: Mapping[str, Any],
    folder: Path,
    *,
    study: Study | None = None,
    computed: Elsewhere | None = None,
    progress: Callable[[int], None] | None = None,
    tell: Callable[[str], object] | None = None,
    shown: Callable[[Path, Content, Frames], object] | None = None,
) -> tuple[dict[str, Any], dict[str, pl.DataFrame]]:
    """Run a study, or the rest of it, and write its results.

    **Arguments:**

    - `tables`: from `read_study`.
    - `folder`: for chunks and results; an interrupted study in it is resumed.
    - `study`: the study made of `tables`, if there is one already.
    - `computed`: computes the missing chunks in any order; this process if omitted. One random chunk of each worker is computed
      again here and compared.
    - `progress`: called with the number of trials after each chunk, the finished ones of an earlier call first.
    - `tell`: given a line on finished chunks that do not verify and are computed again (a warning if omitted), and on workers
      that stopped (logged if omitted).
    - `shown`: draws figures and writes pages of the results into a folder, from which they take their places with these.

    **Returns:** the content of the JSON file, and the tables written as Parquet.

    **Raises:** `InputError` if the folder contains another study, a chunk changes before it is summed up, or a
    worker's chunk is wrong: the chunks of that worker are then removed.
    """
    study = study or study_of(tables)
    check = partial(check_counts, study)
    with closing(Store(folder, tables, study.chunks, check)) as store:
        missing = store.missing(tell or warnings.warn)
        if progress is not None:
            unfinished = set(missing)
            progress(sum(study.trials_of(chunk) for chunk in range(study.chunks) if chunk not in unfinished))
        try:
            report = tell or logging.getLogger(__name__).warning
            here = in_this_process(study, tables, missing)
            for chunk, content, worker in computed(missing, check=check, tell=report) if computed else here:
                store.put(chunk, content, worker)
                if progress is not None:
                    progress(study.trials_of(chunk))
            recheck_workers(study, tables, store)
        except Distrusted as fault:
            store.remove_of(fault.worker)
            raise
        result, frames = study.summary(store.all())
        with result_set(folder, result_names(tables["kind"])) as aside:
            content = _written(tables, aside, result, frames)
            if shown is not None:
                shown(aside, content, frames)
        return content, frames


def result_names(kind: str) -> tuple[str, ...]:
    """The files that the results of a kind of study may have, figures and page included."""
    return (f"{kind}.json", f"{kind}_*.parquet", f"{kind}.html", f"{kind}.svg", "data_sets_needed.svg")


def _written(
    tables: Mapping[str, Any], folder: Path, result: ResultRecord, frames: Mapping[str, pl.DataFrame]
) -> dict[str, Any]:
    """Write the results; returns the content of the JSON file."""
    kind = tables["kind"]
    head = StudyHead(
        schema_=f"tumblecal.study.{kind}/1",
        title=tables["study"].get("title", ""),
        study=tables["study"],
        rig=tables["rig"],
        units=injected_units(tables),
    )
    content = head.plain() | result.plain()
    for name, frame in frames.items():
        with written_aside(folder / f"{kind}_{name}.parquet") as aside:
            frame.write_parquet(aside)
    write_text(folder / f"{kind}.json", json.dumps(content, indent=1, allow_nan=False))
    return content
