"""Coverage: the calculation of `simulation.coverage` in chunks, which are stored, resumed, and handed to workers.

A chunk must have the same bits on every worker and a size that does not depend on its trials, so a study stores the sums that
the public function adds up at once; trials, sums and table are the same functions. With raw samples each position mean is
that of samples drawn one by one.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import polars as pl
from scipy.special import chdtrc

from tumblecal.noise import Dwells, Noise
from tumblecal.noise.sampling import dwell_records
from tumblecal.simulation.coverage import CHUNK, coverage_table, total_of
from tumblecal.simulation.experiment import BLOCK, Experiment, experiment
from tumblecal.simulation.inject import injected_links
from tumblecal.simulation.sums import CHI2_BINS, LEVELS, Sums, chunk_sums, sums_of
from tumblecal.studies.study_record import CoverageResult
from tumblecal.studies.study_tables import CoverageTable, entries_of, noise_of, rig_of_study, table_of


# With raw samples a trial takes seconds.
RAW_CHUNK = 16
# Time to draw one raw sample of one axis and part, us.
RAW_MICROSECONDS = 0.02
# Time of a trial on one core, us, for the estimate before a study starts: 24 positions and 15 parameters.
MICROSECONDS = {"harmonic": 3.0, "chain": 20.0}


class Coverage:
    """One coverage study; `study` from `read_study`."""

    chunks: int
    programs: int
    chunk_bytes: int
    seconds: float

    def __init__(self, study: Mapping[str, Any]):
        table: CoverageTable = table_of(study)
        rig = rig_of_study(study)
        where = rig.where
        sd, covariance = noise_of(table.noise, rig)
        sizes = {name: [size] if isinstance(size, float | int) else size for name, size in table.inject.items()}
        self.table = table
        self.experiment: Experiment = experiment(
            rig.true_chain(where),
            where,
            sd=sd,
            injected=injected_links(sizes, where, entries_of(study)),
            spread=table.truth.spread,
            priors=rig.priors,
            covariance=covariance,
            ability=rig.ability,
            path=table.path,
        )
        self._chunk = RAW_CHUNK if table.raw else CHUNK
        self._sums = jax.jit(self._raw_sums) if table.raw else chunk_sums(self.experiment, table.seed)
        model = table.noise.model()
        self._samples = (model, table.noise.dwells(len(rig.plan))) if table.raw and model is not None else None
        free = len(self.experiment.names)
        self.trials, self.chunks, self.programs = table.trials, -(-table.trials // self._chunk), 1
        self.chunk_bytes = 8 * (free * (free + 1 + 2 * len(LEVELS)) + CHUNK_OVERHEAD)
        self.seconds = self._seconds()

    def _seconds(self) -> float:
        per_trial = MICROSECONDS[self.experiment.path] * self.experiment.readings.shape[0] / 24
        if self.experiment.path == "chain":
            per_trial *= len(self.experiment.names) / 15
        if self._samples is not None:
            model, dwells = self._samples
            per_trial += RAW_MICROSECONDS * 3 * len(model.parts) * dwells.samples * len(dwells.start_s)
        return 1e-6 * per_trial * self.table.trials

    def trials_of(self, chunk: int) -> int:
        """Number of trials in a chunk."""
        return min(self._chunk, self.table.trials - chunk * self._chunk)

    def trials_in(self, arrays: Mapping[str, np.ndarray]) -> float:
        """Trials that a chunk counts."""
        return float(arrays["trials"])

    def compute(self, chunk: int) -> dict[str, np.ndarray]:
        """The sums of one chunk."""
        if self._samples is not None:
            sums = self._raw(chunk, *self._samples)
        else:
            first = chunk * CHUNK
            sums = self._sums(first, first + self.trials_of(chunk))
        return {name: np.asarray(part) for name, part in sums._asdict().items()}

    def _raw(self, chunk: int, model: Noise, dwells: Dwells) -> Sums:
        """The sums of a chunk whose position means are those of samples, drawn one by one."""
        experiment, trials = self.experiment, self.trials_of(chunk)
        truth = experiment.instruments(jax.random.fold_in(jax.random.key(self.table.seed), chunk))
        readings = np.broadcast_to(experiment.true_readings(truth), (*experiment.readings.shape, BLOCK))
        noise = np.zeros((*experiment.readings.shape, BLOCK))
        for lane in range(trials):
            seed = np.random.SeedSequence([self.table.seed, chunk * self._chunk + lane])
            records = dwell_records(model, dwells, seed, signal=readings[:, :, lane])
            means = np.stack([samples.mean(axis=0) for samples in records])
            noise[:, :, lane] = means - readings[:, :, lane]
        return self._sums(truth, noise, np.arange(BLOCK) < trials)

    def _raw_sums(self, truth: jax.Array, noise: jax.Array, wanted: jax.Array) -> Sums:
        return sums_of(self.experiment.calibrated(truth, noise), self.experiment, wanted)

    def summary(self, chunks: Iterable[Mapping[str, np.ndarray]]) -> tuple[CoverageResult, dict[str, pl.DataFrame]]:
        """Statistics from all chunks, added in their order.

        **Returns:** what goes into the JSON file, and tables by name.
        """
        return summary_of(self.experiment, chunks)


# Fixed part of a chunk file: array headers and the other sums, in numbers of eight bytes.
CHUNK_OVERHEAD = 400


def summary_of(
    experiment: Experiment, chunks: Iterable[Mapping[str, np.ndarray]]
) -> tuple[CoverageResult, dict[str, pl.DataFrame]]:
    """Statistics of a coverage study from the sums of its chunks, added in their order."""
    sums = total_of(Sums(*(jnp.asarray(chunk[name]) for name in Sums._fields)) for chunk in chunks)
    n = float(sums.trials - sums.failed)
    z_mean = np.asarray(sums.error) / n
    free, dof = len(experiment.names), experiment.dof
    counts = np.diff(np.concatenate([[0.0], sums.below, [n]]))
    uniform = float(np.sum((counts - n / CHI2_BINS) ** 2) / (n / CHI2_BINS))
    result = CoverageResult(
        path=experiment.path,
        path_reason=experiment.reason,
        trials=int(sums.trials),
        failed=int(sums.failed),
        sd_g=experiment.sd,
        dof=dof,
        chi2_mean=float(sums.chi2) / n,
        chi2_variance=float(sums.chi2_squared) / n - (float(sums.chi2) / n) ** 2,
        chi2_uniformity_p=float(chdtrc(CHI2_BINS - 1, uniform)),
        chi2_histogram=(counts / n).tolist(),
        nees_mean=float(sums.nees) / n,
        nees_variance=float(sums.nees_squared) / n - (float(sums.nees) / n) ** 2,
        nees_expected=free,
        levels=list(LEVELS),
        correlation=(np.asarray(sums.products) / n - np.outer(z_mean, z_mean)).tolist(),
    )
    return result, {"parameters": coverage_table(experiment, sums)}
