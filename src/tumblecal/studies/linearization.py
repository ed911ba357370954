"""Linearisation: bias of the small-angle equations against the exact chain, over the size of the errors.

Readings without noise of random instruments whose errors have a given sd are calibrated by the paper's linear equations
and by least squares over the chain with a first-order mount; the remaining error is bias. It grows with the square of the
size. Where it exceeds the sd of the mean of N data sets the equations are the larger error.

The public `simulation.linearisation_error` is that of one Gauss-Newton step for any chain, not of the paper's equations, which
both fits here are compared with on the same readings in one program. The study shares `chain_fit.fit_chain` with `fit_many`.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import polars as pl
from jaxtyping import Array

from tumblecal.chain.chain import LISTED_FIRST
from tumblecal.chain.nominal import LINKS
from tumblecal.estimation import harmonic
from tumblecal.ground.errors import InputError
from tumblecal.simulation.chain_fit import design, expansion, fit_chain
from tumblecal.simulation.experiment import BLOCK, problem_for
from tumblecal.simulation.harmonic_fit import nominal_harmonics
from tumblecal.simulation.uniform import required_path
from tumblecal.studies.study_record import LinearizationResult
from tumblecal.studies.study_tables import LinearizationTable, noise_of, rig_of_study, table_of


# Which errors grow; the others are zero.
_MOUNT, _PITCH = tuple(LINKS["mount"].leaves), tuple(LINKS["pitch_axis"].leaves)
CASES = {"mount": _MOUNT, "pitch": _PITCH, "mount and pitch": _MOUNT + _PITCH, "all": LISTED_FIRST}
PATHS = ("harmonic", "small angle")
# Time of an instrument, us: the small-angle fit falls back to its own Jacobians for large errors.
MICROSECONDS = 60.0


class Linearization:
    """One linearisation study; `study` from `read_study`. A chunk is one size of one case."""

    table: LinearizationTable
    names: tuple[str, ...]
    units: tuple[str, ...]
    sd: float
    chunks: int
    programs: int
    trials: int
    chunk_bytes: int
    seconds: float

    def __init__(self, study: Mapping[str, Any]):
        table: LinearizationTable = table_of(study)
        rig = rig_of_study(study)
        where = rig.where
        exact = rig.chain(where)
        self.table, self.names, self.units = table, exact.names, exact.units
        self.sd, _ = noise_of(table.noise, rig)
        problem = problem_for(exact, where, self.sd)
        self.plan = plan = required_path(problem, f"{rig.source}: a linearisation")
        if not 0 < table.smallest < table.largest:
            raise InputError(f"{study['source']}: smallest must be above 0 and below largest")
        self.sizes = np.geomspace(table.smallest, table.largest, table.sizes)
        _, to_values = design(problem)
        self.predicted_sd = np.sqrt(np.diag(to_values @ to_values.T))
        first_order = exact_to_small_angle(rig, where)
        self._small_angle = problem_for(first_order, where, self.sd)
        self._expansion = expansion(self._small_angle)
        equations, ideal = harmonic.equations(plan.pitch)
        weights = np.tile(plan.weights, 3 * len(plan.pitch)) ** 0.5
        self._gain = np.linalg.pinv(weights[:, None] * equations) * weights
        self._ideal = ideal
        self._biases = jax.jit(self._compiled)
        # One chunk for each case and size.
        self.chunks, self.programs = len(CASES) * len(self.sizes), 1
        self.trials = self.chunks * table.instruments
        self.chunk_bytes = 8 * (4 * len(PATHS) * len(self.names) + 200)
        self.seconds = 1e-6 * MICROSECONDS * -(-table.instruments // BLOCK) * BLOCK * self.chunks

    def trials_of(self, chunk: int) -> int:
        """Instruments in a chunk."""
        return self.table.instruments

    def trials_in(self, arrays: Mapping[str, np.ndarray]) -> float:
        """Instruments that a chunk counts: the linear equations are solved for every one."""
        return float(arrays["count"][0])

    def compute(self, chunk: int) -> dict[str, np.ndarray]:
        """Sums of bias and of its square, its largest size and the number of instruments, by path and parameter."""
        case, size = divmod(chunk, len(self.sizes))
        grows = np.array([name.rsplit("_", 1)[0] in list(CASES.values())[case] for name in self.names], float)
        parts = []
        for block in range(-(-self.table.instruments // BLOCK)):
            wanted = block * BLOCK + np.arange(BLOCK) < self.table.instruments
            parts.append(self._biases(block, grows * self.sizes[size], wanted))
        arrays = {name: np.stack([np.asarray(part[name]) for part in parts]) for name in parts[0]}
        return {name: part.max(axis=0) if name == "largest" else part.sum(axis=0) for name, part in arrays.items()}

    def _compiled(self, block: Array, spread: Array, wanted: Array) -> dict[str, Array]:
        # The same instruments at every size, scaled: the bias over the size is then free of sampling noise.
        key = jax.random.fold_in(jax.random.key(self.table.seed), block)
        truth = spread[:, None] * jax.random.normal(key, (len(self.names), BLOCK))
        harmonics = nominal_harmonics(truth, self.plan.pitch)
        # The linear equations list harmonics by setting, axis, harmonic.
        listed = jnp.swapaxes(harmonics, 1, 2).reshape(-1, BLOCK)
        linear = self._gain @ (listed - self._ideal[:, None])
        fits = fit_chain(self._small_angle, self._expansion, jnp.moveaxis(self.plan.synthesis(harmonics), 2, 0))
        good = jnp.stack([wanted, wanted & fits.converged])
        bias = jnp.stack([linear - truth, fits.values.T - truth])
        bias = jnp.where(good[:, None], bias, 0.0)
        return {
            "bias": jnp.sum(bias, axis=2),
            "squares": jnp.sum(bias**2, axis=2),
            "largest": jnp.max(jnp.abs(bias), axis=2),
            "count": jnp.sum(jnp.asarray(good, float), axis=1),
        }

    def summary(
        self, chunks: Iterable[Mapping[str, np.ndarray]]
    ) -> tuple[LinearizationResult, dict[str, pl.DataFrame]]:
        """Bias by size, and the sizes at which it exceeds the sd of N data sets.

        **Returns:** what goes into the JSON file, and tables by name.
        """
        rows, rms = [], np.zeros((len(CASES), len(PATHS), len(self.sizes), len(self.names)))
        failed = 0.0
        for number, chunk in enumerate(chunks):
            case, size = divmod(number, len(self.sizes))
            failed += float(np.sum(self.table.instruments - chunk["count"]))
            count = np.maximum(chunk["count"], 1.0)[:, None]
            rms[case, :, size] = np.sqrt(chunk["squares"] / count)
            for path, label in enumerate(PATHS):
                for p, name in enumerate(self.names):
                    mean = float(chunk["bias"][path, p] / count[path, 0])
                    largest = float(chunk["largest"][path, p])
                    spread = float(rms[case, path, size, p])
                    rows.append((list(CASES)[case], label, self.sizes[size], name, mean, spread, largest))
        columns = ["case", "path", "size", "parameter", "mean_bias", "rms_bias", "largest_bias"]
        biases = pl.DataFrame(rows, schema=columns, orient="row")
        crossings, answers = self._crossings(rms)
        result = LinearizationResult(
            sd_g=self.sd,
            instruments=self.table.instruments,
            failed=int(failed),
            predicted_sd=dict(zip(self.names, self.predicted_sd.tolist(), strict=True)),
            slopes=self._slopes(rms),
            answers=answers,
        )
        return result, {"biases": biases, "crossings": crossings}

    def _crossings(self, rms: np.ndarray) -> tuple[pl.DataFrame, list[str]]:
        rows, answers = [], []
        for c, case in enumerate(CASES):
            for q, path in enumerate(PATHS):
                for sets in self.table.data_sets:
                    sizes = [
                        crossing(self.sizes, rms[c, q, :, p], self.predicted_sd[p] / np.sqrt(sets))
                        for p in range(len(self.names))
                    ]
                    rows += [(case, path, sets, name, size) for name, size in zip(self.names, sizes, strict=True)]
                    answers.append(self._answer(case, path, sets, sizes))
        columns = ["case", "path", "data_sets", "parameter", "size"]
        schema = dict(zip(columns, (pl.String, pl.String, pl.Int64, pl.String, pl.Float64), strict=True))
        return pl.DataFrame(rows, schema=schema, orient="row"), answers

    def _answer(self, case: str, path: str, sets: int, sizes: list[float | None]) -> str:
        known = [(size, name) for size, name in zip(sizes, self.names, strict=True) if size is not None]
        subject = f"{path} equations, {case} errors, {sets} data set{'s' if sets > 1 else ''}"
        if not known:
            return f"{subject}: good enough up to {1e3 * self.sizes[-1]:.3g} mrad and beyond"
        size, name = min(known)
        if size <= self.sizes[0]:
            return f"{subject}: not good enough even at {1e3 * self.sizes[0]:.3g} mrad (bias of {name} above its sd)"
        return f"{subject}: good enough up to {1e3 * size:.2g} mrad (then the bias of {name} exceeds its sd)"

    def _slopes(self, rms: np.ndarray) -> dict[str, dict[str, float]]:
        """Slope of the worst parameter's bias over the lower half of the sizes, on logarithmic axes: 2 in theory."""
        half = max(2, len(self.sizes) // 2)
        slopes: dict[str, dict[str, float]] = {}
        for c, case in enumerate(CASES):
            for q, path in enumerate(PATHS):
                worst = (rms[c, q] / self.predicted_sd).max(axis=1)[:half]
                # Rounding leaves 1e-16 where the equations are exact: no slope there.
                if np.all(worst * self.predicted_sd.max() > 1e-13):
                    slope = float(np.polyfit(np.log(self.sizes[:half]), np.log(worst), 1)[0])
                    slopes.setdefault(case, {})[path] = slope
        return slopes


def exact_to_small_angle(rig, where):
    """The rig's chain with the paper's first-order mount."""
    import dataclasses

    links = tuple("small_angle_mount" if name == "mount" else name for name in rig.links)
    return dataclasses.replace(rig, links=links).chain(where)


def crossing(sizes: np.ndarray, bias: np.ndarray, sd: float) -> float | None:
    """The size at which the bias first reaches `sd`, by interpolation of the logarithms; None when it does not."""
    above = np.nonzero(bias >= sd)[0]
    if not len(above):
        return None
    first = int(above[0])
    if first == 0:
        return float(sizes[0])
    logs = np.log(np.maximum(bias[first - 1 : first + 1], 1e-300))
    share = (np.log(sd) - logs[0]) / (logs[1] - logs[0])
    return float(np.exp(np.log(sizes[first - 1]) + share * np.log(sizes[first] / sizes[first - 1])))
