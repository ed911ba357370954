"""Power: how often an effect is detected, and named rightly, over its size.

A trial is a diagnosis of a position set, while `monte_carlo` fits blocks of trials. The study shares `Diagnoser` with
`diagnose` and `diagnose_many`.
"""

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import jax
import numpy as np
import polars as pl

from tumblecal.chain import Chain, Where
from tumblecal.data import PositionSet
from tumblecal.diagnosis import Diagnoser
from tumblecal.diagnosis.causes.cause import id_of
from tumblecal.effects.catalogue import entry
from tumblecal.ground.errors import InputError
from tumblecal.ground.precision import single_blas_thread
from tumblecal.simulation.experiment import spread_of, with_known_coefficients
from tumblecal.simulation.inject import injected_links
from tumblecal.studies.study_record import PowerResult, RateResult
from tumblecal.studies.study_tables import PowerTable, entries_of, noise_of, rig_of_study, table_of


CHUNK = 20  # runs
# Measured with 48 positions on a slow core: 0.04 s.
SECONDS_A_RUN = 0.05
COUNTS = ("runs", "detected", "named", "named_alone", "failed")


class Power:
    """One power study; `study` from `read_study`. Sizes of 0 give the rate of false alarms."""

    table: PowerTable
    where: Where
    points: list[tuple[str, float]]
    effect_units: dict[str, str]
    sd: float
    trials: int
    chunks: int
    chunk_bytes: int
    seconds: float
    programs: int

    def __init__(self, study: Mapping[str, Any]):
        table: PowerTable = table_of(study)
        rig = rig_of_study(study)
        self.table, self.rig, self.where = table, rig, rig.where
        entries = entries_of(study)
        self.points = [(name, float(size)) for name, sizes in table.effects.items() for size in sizes]
        self.effect_units = {name: entry(entries, name).unit for name in table.effects}
        self.sd, covariance = noise_of(table.noise, rig)
        self._root = None if covariance is None else np.linalg.cholesky(covariance)
        chain = rig.true_chain(self.where)
        self._spread = spread_of(chain, table.truth.spread)
        self._readings, faults = [], []
        for name, size in self.points:
            try:
                simulated = chain
                for link in injected_links({name: [size]}, self.where, entries):
                    simulated = simulated + with_known_coefficients(link)
                self._readings.append(jax.jit(partial(_readings_of, simulated, self.where)))
            except InputError as error:
                faults += error.faults
        if faults:
            raise InputError(faults)
        self._truth = chain.vector
        self._diagnoser = Diagnoser(entries, nested=False)
        self._of_point = -(-table.runs // CHUNK)
        self.trials, self.chunks = len(self.points) * table.runs, len(self.points) * self._of_point
        self.chunk_bytes, self.seconds, self.programs = 2000, SECONDS_A_RUN * self.trials, 1

    def trials_of(self, chunk: int) -> int:
        """Runs in a chunk."""
        return min(CHUNK, self.table.runs - chunk % self._of_point * CHUNK)

    def trials_in(self, arrays: Mapping[str, np.ndarray]) -> float:
        """Runs that a chunk counts."""
        return float(arrays["counts"][0])

    def compute(self, chunk: int) -> dict[str, np.ndarray]:
        """Counts of one chunk."""
        point, part = divmod(chunk, self._of_point)
        counts = np.zeros(len(COUNTS))
        for run in range(self.trials_of(chunk)):
            counts += self._run(point, part * CHUNK + run)
        return {"counts": counts}

    def _run(self, point: int, run: int) -> np.ndarray:
        generator = np.random.default_rng(np.random.SeedSequence([self.table.seed, point, run]))
        vector = self._truth + self._spread * generator.standard_normal(len(self._truth))
        white = generator.standard_normal((len(self.rig.plan), 3))
        noise = self.sd * white if self._root is None else np.einsum("apq,qa->pa", self._root, white)
        plan = self.rig.plan
        data = PositionSet(
            names=plan.names,
            alpha_deg=np.asarray(plan.alpha_deg, float),
            beta_deg=np.asarray(plan.beta_deg, float),
            readings=np.asarray(self._readings[point](vector)) + noise,
            run=plan.runs if len(set(plan.runs)) > 1 else None,
            mount=plan.mounts if set(plan.mounts) != {"1"} else None,
            source=f"run {run}",
        )
        try:
            with single_blas_thread():
                begun = self._diagnoser.begun(data, noise_sd=self.sd if self.table.noise_stated else None)
        except InputError:
            return np.array([1.0, 0.0, 0.0, 0.0, 1.0])
        # Detected; named among the best explanation or its equivalents; named alone, as the one cause.
        effect, labels, detected = self.points[point][0], tuple(map(id_of, begun.labels)), not begun.adequate
        among = {id_of(label) for names in begun.screened.best.equivalents for label in names} | set(labels)
        return np.array([1.0, detected, detected and effect in among, detected and labels == (effect,), 0.0], float)

    def summary(self, chunks: Iterable[Mapping[str, np.ndarray]]) -> tuple[PowerResult, dict[str, pl.DataFrame]]:
        """Rates of detection and naming for each effect and size.

        **Returns:** what goes into the JSON file, and the table of rates.
        """
        totals = np.zeros((len(self.points), len(COUNTS)))
        for number, chunk in enumerate(chunks):
            totals[number // self._of_point] += chunk["counts"]
        rows = []
        for (name, size), (runs, detected, named, alone, failed) in zip(self.points, totals, strict=True):
            good = max(runs - failed, 1.0)
            rates = (detected / good, named / good, alone / good)
            rows.append((name, size, self.effect_units[name], int(runs), int(failed), *rates))
        columns = ["effect", "size", "unit", "runs", "failed", "detected", "named", "named_alone"]
        frame = pl.DataFrame(rows, schema=columns, orient="row")
        return PowerResult(sd_g=self.sd, rates=[RateResult(**row) for row in frame.to_dicts()]), {"rates": frame}


def _readings_of(chain: Chain, where: Where, vector: jax.Array) -> jax.Array:
    return chain.at(vector)(where)
