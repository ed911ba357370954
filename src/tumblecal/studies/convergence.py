"""Convergence: how many data sets it takes to reach a given error, by each method (the paper's figures 4 to 9).

The paper shows one run; here it is a distribution over thousands. A filter with constant state, H and R has gains
that do not depend on the data: with a prior of equal variance for all parameters and the eigenvectors of
`H'R^-1 H = V diag(f) V'` its estimate after N data sets is `V diag(1/(1/p^2 + N f)) V' H'R^-1 sum(z)`, the same numbers
as the recursion's.

A run is a sequence of data sets with the state of the filters between them, which `monte_carlo` does not have. The study and
`monte_carlo` share the exact fit of many readings, `harmonic_fit.fit_harmonics`.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import polars as pl
from jaxtyping import Array

from tumblecal.estimation import harmonic
from tumblecal.ground.errors import InputError
from tumblecal.simulation.evaluated_once import materialised
from tumblecal.simulation.experiment import problem_for, spread_of
from tumblecal.simulation.harmonic_fit import fit_harmonics, nominal_harmonics
from tumblecal.simulation.noise_steps import noise_steps
from tumblecal.simulation.uniform import required_path
from tumblecal.studies.study_record import ConvergenceResult, SettledResult
from tumblecal.studies.study_tables import ConvergenceTable, noise_of, rig_of_study, table_of


# Runs in a chunk.
CHUNK = 128
# Time on one core for one data set of one run, us.
MICROSECONDS = {"single": 1.0, "mean": 1.0, "kalman": 1.0, "exact": 2.0, "noise": 1.0}


class Convergence:
    """One convergence study; `study` from `read_study`."""

    table: ConvergenceTable
    names: tuple[str, ...]
    units: tuple[str, ...]
    sd: float
    methods: list[tuple[str, str, float]]
    trials: int
    chunks: int
    programs: int
    chunk_bytes: int
    seconds: float

    def __init__(self, study: Mapping[str, Any]):
        table: ConvergenceTable = table_of(study)
        rig = rig_of_study(study)
        if rig.temperature.leaves:
            raise InputError(
                f"{rig.source}: [temperature]: a convergence study uses the paper's linear equations, in which parameters are "
                "constant; remove [temperature], or use a coverage study (tumblecal study coverage)"
            )
        chain = rig.true_chain(rig.where)
        self.table, self.names, self.units = table, chain.names, chain.units
        self.sd, _ = noise_of(table.noise, rig)
        self.plan = plan = required_path(problem_for(chain, rig.where, self.sd), f"{rig.source}: a convergence")
        self.truth, self.spread = chain.vector, spread_of(chain, table.truth.spread)
        model = table.noise.model()
        self.noise = None if model is None else noise_steps(model, table.noise.dwells(max(len(rig.plan), 2)))
        # H and the ideal instrument's harmonics, their rows in this module's order (setting, harmonic, axis).
        design, ideal = harmonic.equations(plan.pitch)
        count = len(plan.pitch)
        order = np.arange(9 * count).reshape(count, 3, 3).transpose(0, 2, 1).ravel()
        self.design, self.ideal = design[order], ideal[order]
        self.variance = np.tile(np.repeat(self.sd**2 / plan.weights, 3), count)
        self.methods = self._methods()
        self._runs = jax.jit(self._compiled)
        free, sets, methods = len(self.names), table.data_sets, len(self.methods)
        # A trial is a data set of a run.
        self.trials, self.chunks, self.programs = table.runs * sets, -(-table.runs // CHUNK), 1
        self.chunk_bytes = methods * (8 * sets * (2 * free + 3) + 4 * CHUNK * free * len(table.thresholds))
        self.seconds = self._seconds()

    def _methods(self) -> list[tuple[str, str, float]]:
        """(label, method, prior sd) in the order of all arrays."""
        methods: list[tuple[str, str, float]] = []
        for name in self.table.methods:
            priors = self.table.prior_sd if name == "kalman" else [0.0]
            methods += [(name if not sd else f"{name}, prior sd {sd:g}", name, sd) for sd in priors]
        return methods

    def _seconds(self) -> float:
        data_set = sum(MICROSECONDS[method] for _, method, _ in self.methods) + MICROSECONDS["noise"]
        if self.noise is not None:
            data_set += 0.02 * self.noise.start.size * 2 * self.plan.rows.size
        return 1e-6 * data_set * self.trials

    def trials_of(self, chunk: int) -> int:
        """Number of data sets in a chunk, over all its runs."""
        return min(CHUNK, self.table.runs - chunk * CHUNK) * self.table.data_sets

    def trials_in(self, arrays: Mapping[str, np.ndarray]) -> float:
        """Data sets that a chunk counts: those of its runs, of which no method can have solved more."""
        runs = max(float(arrays["settled"].shape[-1]), float(arrays["count"].max()))
        return runs * self.table.data_sets

    def compute(self, chunk: int) -> dict[str, np.ndarray]:
        """Error sums by data set, and after how many data sets each run has settled."""
        wanted = np.arange(CHUNK) + chunk * CHUNK < self.table.runs
        sums, settled = self._runs(chunk, wanted)
        arrays = {name: np.asarray(part) for name, part in sums.items()}
        return arrays | {"settled": np.asarray(settled).astype(np.int32)[..., wanted]}

    def _compiled(self, chunk: Array, wanted: Array):
        key = jax.random.fold_in(jax.random.key(self.table.seed), chunk)
        drawn = jax.random.normal(jax.random.fold_in(key, 0), (len(self.names), CHUNK))
        truth = jnp.asarray(self.truth)[:, None] + self.spread[:, None] * drawn
        exact = materialised(nominal_harmonics(truth, self.plan.pitch).reshape(-1, CHUNK))
        keys = jax.random.split(jax.random.fold_in(key, 1), self.table.data_sets)
        free, thresholds = len(self.names), np.asarray(self.table.thresholds)
        bounds = thresholds[None, :, None, None]

        def step(state, given):
            count, total, noise_state, last_bad = state
            noise_state, noise = self._noise(noise_state, given)
            z = exact + noise
            total = total + z
            errors, nees, nis, failed = self._estimates(count, z, total, truth)
            bad = (jnp.abs(errors)[:, None] >= bounds) | failed[:, None, None]
            last_bad = jnp.where(bad, count, last_bad)
            weight = wanted[None] & ~failed
            errors = jnp.where(weight[:, None], errors, 0.0)
            sums = {
                "error": jnp.sum(errors, axis=2),
                "squares": jnp.sum(errors**2, axis=2),
                "nees": jnp.sum(jnp.where(weight, nees, 0.0), axis=1),
                "nis": jnp.sum(jnp.where(weight, nis, 0.0), axis=1),
                "count": jnp.sum(jnp.asarray(weight, float), axis=1),
            }
            return (count + 1, total, noise_state, last_bad), sums

        state = (
            jnp.ones(()),
            jnp.zeros((9 * len(self.plan.pitch), CHUNK)),
            self._first_noise(jax.random.fold_in(key, 2)),
            jnp.zeros((len(self.methods), len(thresholds), free, CHUNK)),
        )
        (_, _, _, last_bad), sums = jax.lax.scan(step, state, keys)
        return sums, last_bad + 1

    def _first_noise(self, key: Array):
        return jnp.zeros(()) if self.noise is None else self.noise.first(key, CHUNK)

    def _noise(self, state, key: Array):
        """Noise of one data set's harmonics; white noise is drawn as such: its harmonics are independent."""
        if self.noise is None:
            return state, jnp.sqrt(self.variance)[:, None] * jax.random.normal(key, (len(self.variance), CHUNK))
        state, means = self.noise.dwells(state, key, self.plan.rows.size)
        return state, materialised(self.plan.harmonics(means).reshape(-1, CHUNK))

    def _estimates(self, count, z, total, truth):
        """Errors (methods, free, lanes), NEES and NIS (methods, lanes), failures (methods, lanes)."""
        design, weights = self.design, 1.0 / self.variance
        normal = design.T @ (weights[:, None] * design)
        f, V = np.linalg.eigh(normal)
        into = V.T @ (design.T * weights)  # harmonics to the eigenvectors' information
        ideal = self.ideal[:, None]
        now, so_far = into @ (z - ideal), into @ (total - count * ideal)
        white = jnp.sum((z - ideal) ** 2 * weights[:, None], axis=0)
        rows: list[tuple[Array, Array, Array, Array]] = []
        fine = jnp.zeros(truth.shape[1], bool)
        for _, method, sd in self.methods:
            nothing = jnp.full(truth.shape[1], jnp.nan)
            if method == "exact":
                shape = (len(self.plan.pitch), 3, 3, -1)
                fits = fit_harmonics((total / count).reshape(shape), self.plan.pitch, self.plan.angles)
                values = materialised(jnp.where(fits.converged[None], fits.values, 0.0))
                error = values - truth
                rows.append((error, count * jnp.sum((V.T @ error) ** 2 * f[:, None], axis=0), nothing, ~fits.converged))
            else:
                precision, information = {
                    "single": (f, now),
                    "mean": (count * f, so_far),
                    "kalman": (1 / sd**2 + count * f if sd else f, so_far),
                }[method]
                precision = jnp.asarray(precision)[:, None]
                along = information / precision
                error = V @ along - truth
                nees = jnp.sum((V.T @ error) ** 2 * precision, axis=0)
                nis = self._nis(count, sd, f, now, so_far, white) if method == "kalman" else nothing
                rows.append((error, nees, nis, fine))
        return tuple(jnp.stack(column) for column in zip(*rows, strict=True))

    @staticmethod
    def _nis(count, sd, f, now, so_far, white):
        """Normalised innovation squared before this data set was taken in, in the eigenvectors' coordinates:
        `v'R^-1 v - b'P_N b` with b = V'H'R^-1 v, v = z - H x."""
        f = jnp.asarray(f)[:, None]
        before = (so_far - now) / (1 / sd**2 + (count - 1) * f)
        b = now - f * before
        squares = white - jnp.sum(before * (2 * now - f * before), axis=0)
        return squares - jnp.sum(b**2 / (1 / sd**2 + count * f), axis=0)

    def summary(self, chunks: Iterable[Mapping[str, np.ndarray]]) -> tuple[ConvergenceResult, dict[str, pl.DataFrame]]:
        """Errors by number of data sets, and the distribution of the number needed.

        **Returns:** what goes into the JSON file, and tables by name.
        """
        total: dict[str, np.ndarray] = {}
        settled = []
        for chunk in chunks:
            settled.append(chunk["settled"])
            total = {name: total.get(name, 0.0) + chunk[name] for name in chunk if name != "settled"}
        return summary_of(self, total, np.concatenate(settled, axis=-1))


def summary_of(
    study: Convergence, total: Mapping[str, np.ndarray], settled: np.ndarray
) -> tuple[ConvergenceResult, dict[str, pl.DataFrame]]:
    """Tables of a convergence study."""
    labels, names = [label for label, _, _ in study.methods], study.names
    steps, methods, free = total["error"].shape
    count = np.maximum(total["count"], 1)[:, :, None]
    sets = np.arange(1, steps + 1)
    errors = pl.DataFrame(
        {
            "method": np.tile(np.repeat(labels, free), steps),
            "data_sets": np.repeat(sets, methods * free),
            "parameter": np.tile(np.array(names), steps * methods),
            "bias": (total["error"] / count).ravel(),
            "rms": np.sqrt(total["squares"] / count).ravel(),
        }
    )
    consistency = pl.DataFrame(
        {
            "method": np.tile(labels, steps),
            "data_sets": np.repeat(sets, methods),
            "nees": (total["nees"] / count[:, :, 0]).ravel(),
            "nis": pl.Series((total["nis"] / count[:, :, 0]).ravel()).fill_nan(None),
            "failed": (study.table.runs - total["count"]).ravel(),
        }
    )
    rows = []
    for m, label in enumerate(labels):
        for t, threshold in enumerate(study.table.thresholds):
            for p, name in enumerate(names):
                needed = settled[m, t, p]
                never = needed > steps
                counts = np.sort(np.where(never, np.inf, needed))
                low, middle, high = (float(counts[min(int(q * len(counts)), len(counts) - 1)]) for q in (0.1, 0.5, 0.9))
                rows.append((label, threshold, name, low, middle, high, float(np.mean(never))))
    columns = ("method", "threshold", "parameter", "p10", "median", "p90", "never")
    needed = pl.DataFrame(rows, schema=list(columns), orient="row")
    result = ConvergenceResult(
        runs=study.table.runs,
        data_sets=steps,
        methods=labels,
        sd_g=study.sd,
        noise="white" if study.noise is None else "coloured",
        nees_expected=free,
        nis_expected=len(study.variance),
        settled={
            label: {f"{threshold:g}": _worst(needed, label, threshold, steps) for threshold in study.table.thresholds}
            for label in labels
        },
    )
    return result, {"errors": errors, "consistency": consistency, "needed": needed}


def _worst(needed: pl.DataFrame, label: str, threshold: float, steps: int) -> SettledResult:
    """The parameter that needs most data sets: its name and median, None where half of the runs never settle."""
    rows = needed.filter((pl.col("method") == label) & (pl.col("threshold") == threshold))
    row = rows.sort("median", "parameter").row(-1, named=True)
    median = row["median"]
    return SettledResult(parameter=row["parameter"], median_data_sets=int(median) if median <= steps else None)
