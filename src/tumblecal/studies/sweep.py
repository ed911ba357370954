"""Sweep: a coverage study at every point of a grid over any value of the rig or of the study.

`simulation.sweep` takes problems that are ready; here a point is a text that a worker turns into its problem. The chunks of a
point are those of its coverage study, so a sweep is resumed and distributed as it is.
"""

import copy
import itertools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from tumblecal.chain.rig_file import rig_of
from tumblecal.effects.catalogue import links_and_units
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import faults_of
from tumblecal.ground.text_file import shown
from tumblecal.studies.coverage import Coverage, summary_of
from tumblecal.studies.study_record import PointResult, SweepResult
from tumblecal.studies.study_tables import SweepTable, entries_of, noise_stated, table_faults, table_of


class Sweep:
    """One sweep; `study` from `read_study`. Its chunks are those of its points, one point after the other."""

    grid: dict[str, list[Any]]
    points: list[tuple[dict[str, Any], dict[str, Any]]]
    chunk_bytes: int
    programs: int
    trials: int
    chunks: int
    seconds: float

    def __init__(self, study: Mapping[str, Any]):
        table: SweepTable = table_of(study)
        self.grid, self.points = table.grid, points_of(study)
        self._current: tuple[int, Coverage] | None = None
        first = self._coverage(0)
        self._of_point = first.chunks
        # A plan that grows with the grid takes longer: count the last point too.
        seconds = (first.seconds + self._coverage(len(self.points) - 1).seconds) / 2
        self._trials, self.chunk_bytes, self.programs = first.trials_of, first.chunk_bytes, len(self.points)
        self.trials, self.chunks = first.trials * len(self.points), first.chunks * len(self.points)
        self.seconds = seconds * len(self.points)

    def _coverage(self, point: int) -> Coverage:
        """The coverage study of a point; the last one is cached, with its compiled program."""
        if self._current is None or self._current[0] != point:
            with faults_of(f"grid point {self.points[point][0]}"):
                self._current = point, Coverage(self.points[point][1])
        return self._current[1]

    def trials_of(self, chunk: int) -> int:
        """Number of trials in a chunk."""
        return self._trials(chunk % self._of_point)

    def trials_in(self, arrays: Mapping[str, np.ndarray]) -> float:
        """Trials that a chunk counts."""
        return float(arrays["trials"])

    def compute(self, chunk: int) -> dict[str, np.ndarray]:
        """The sums of one chunk of one point."""
        point, chunk_of_point = divmod(chunk, self._of_point)
        return self._coverage(point).compute(chunk_of_point)

    def summary(self, chunks: Iterable[Mapping[str, np.ndarray]]) -> tuple[SweepResult, dict[str, pl.DataFrame]]:
        """Statistics of all points.

        **Returns:** what goes into the JSON file, and one table with a row for each point and parameter.
        """
        chunks, points, frames = iter(chunks), [], []
        for number, (values, _) in enumerate(self.points):
            coverage = self._coverage(number)
            result, tables = summary_of(coverage.experiment, itertools.islice(chunks, self._of_point))
            points.append(PointResult.of(result, values=values))
            values_of_point = [pl.lit(_shown(value)).alias(name) for name, value in values.items()]
            frames.append(tables["parameters"].select(pl.lit(number).alias("point"), *values_of_point, pl.all()))
        return SweepResult(grid=self.grid, points=points), {"parameters": pl.concat(frames)}


def _shown(value: object) -> str | float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else str(value)


def points_of(study: Mapping[str, Any]) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Values and coverage study of every point of a sweep, the last path of the grid running fastest.

    **Raises:** `InputError` with the faults of all points, by the path and value of the grid that make them.
    """
    grid, faults, points = study["study"]["grid"], dict[str, None](), []
    for values in itertools.product(*grid.values()):
        chosen = dict(zip(grid, values, strict=True))
        tables, wrong = _point(study, chosen)
        points.append((chosen, tables))
        if not wrong:
            continue
        # Study and rig are valid without the grid, so a value that is invalid alone is reported alone.
        alone = [
            f"{study['source']}: grid.{path} = {shown(value)}: {fault}"
            for path, value in chosen.items()
            for fault in _point(study, {path: value})[1]
        ]
        faults |= dict.fromkeys(alone or [f"{study['source']}: grid, at {chosen}: {fault}" for fault in wrong])
    if faults:
        raise InputError(list(faults))
    return points


def _point(study: Mapping[str, Any], chosen: Mapping[str, object]) -> tuple[dict[str, Any], list[str]]:
    """The coverage study with values put at paths of a grid, and what is wrong with it."""
    base = {name: part for name, part in study["study"].items() if name != "grid"}
    base["schema"] = "tumblecal.study.coverage/1"
    tables = {"kind": "coverage", "study": copy.deepcopy(base), "rig": copy.deepcopy(study["rig"])}
    tables |= {name: study[name] for name in ("effects",) if name in study} | {"source": study["source"]}
    faults, nowhere = list[str](), Path()
    for path, value in chosen.items():
        try:
            _put(tables, path, value)
        except InputError as error:
            return tables, list(error.faults)
    faults += table_faults("coverage", tables["study"], nowhere)
    try:
        rig = rig_of(tables["rig"], nowhere, *links_and_units(entries_of(study)))
        if not faults:
            noise_stated(table_of(tables).noise, rig)
    except InputError as error:
        faults += error.faults
    return tables, [fault.removeprefix(f"{nowhere}: ") for fault in faults]


def _put(tables: dict[str, Any], path: str, value: object) -> None:
    """Set the value at a dotted path; a key with dots in it (an effect's id) is the rest of the path."""
    root, _, rest = path.partition(".")
    if root not in ("rig", "study") or not rest:
        raise InputError("a path starts with rig. or study., such as rig.noise.sd")
    table = tables[root]
    while "." in rest:
        key, _, remaining = rest.partition(".")
        if key == "inject":
            table, rest = table.setdefault(key, {}), remaining
            break
        following = table.setdefault(key, {}) if isinstance(table, dict) else None
        if not isinstance(following, dict):
            raise InputError(f"{key!r} contains no tables")
        table, rest = following, remaining
    table[rest] = value
