"""One block of trials: draw an instrument and its noise, calibrate, compare with the truth.

Trials are numbered; `BLOCK` of them that start at a multiple of it are always drawn and fitted together by the same
compiled program, with the random key `fold_in(key(seed), block)`. So the bits of a trial depend on its number alone, not
on how many are asked for, in which order, or by how many processes.
"""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from tumblecal.chain import Chain, Link, Where, with_parameters
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.problem import Problem
from tumblecal.ground.errors import InputError
from tumblecal.simulation.chain_fit import Expansion, design, expansion, fit_chain
from tumblecal.simulation.harmonic_fit import fit_harmonics, nominal_harmonics
from tumblecal.simulation.uniform import UniformPlan, harmonic_path


BLOCK = 1024


class Trials(NamedTuple):
    """A block of calibrations: truth and estimates (base units), weighted sum of squares, which lanes converged."""

    truth: Float[Array, "free lanes"]
    values: Float[Array, "free lanes"]
    chi2: Float[Array, " lanes"]
    converged: Bool[Array, " lanes"]


class Experiment(eqx.Module):
    """A simulated calibration.

    - `truth`: free parameters of the fitted chain at their true values; `spread`: sd of a random instrument about it.
    - `problem`: the fit, its chain at the truth. `simulated`: the chain that makes the readings, injected effects included.
    - `readings`: its readings at the truth, g; `beyond`: their part beyond the harmonics, None if zero.
    - `factor`: square root of the noise's covariance over positions, one per axis, or None for white noise.
    - `sd`: the stated sd of a reading, g: of the white noise, of the weights and of the predicted covariance.
    - `covariance`: predicted, of the estimates.
    - `path`: `"harmonic"` (exact harmonics of a uniform plan) or `"chain"`; `reason`: why not the former.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    truth: Float[np.ndarray, " free"]
    spread: Float[np.ndarray, " free"] | None
    problem: Problem
    simulated: Chain
    readings: Float[np.ndarray, "positions 3"]
    beyond: Float[np.ndarray, "positions 3"] | None
    factor: Float[np.ndarray, "3 positions positions"] | None
    sd: float = eqx.field(static=True)
    covariance: Float[np.ndarray, "free free"]
    path: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    plan: UniformPlan | None = eqx.field(static=True)
    shared: Expansion | None

    @property
    def dof(self) -> int:
        """Degrees of freedom of the sum of squares, priors counted as readings."""
        return self.readings.size + self.problem.priors - len(self.names)

    def noise(self, key: Array) -> Float[Array, "positions 3 lanes"]:
        """Noise of one block, g."""
        white = jax.random.normal(key, (*self.readings.shape, BLOCK))
        if self.factor is None:
            return self.sd * white
        return jnp.einsum("apq,qal->pal", self.factor, white)

    def trials(self, seed: int | Array, block: int | Int[Array, ""]) -> Trials:
        """Trials `block * BLOCK` to `(block + 1) * BLOCK - 1`; pure, to be compiled."""
        key = jax.random.fold_in(jax.random.key(seed), block)
        return self.calibrated(self.instruments(key), self.noise(key))

    def instruments(self, key: Array) -> Float[Array, "free lanes"]:
        """True parameters of one block."""
        if self.spread is None:
            return jnp.broadcast_to(jnp.asarray(self.truth)[:, None], (len(self.truth), BLOCK))
        drawn = jax.random.normal(jax.random.fold_in(key, 1), (len(self.truth), BLOCK))
        return jnp.asarray(self.truth)[:, None] + self.spread[:, None] * drawn

    def calibrated(self, truth: Float[Array, "free lanes"], noise: Float[Array, "positions 3 lanes"]) -> Trials:
        """Estimates from readings of these instruments with this noise, g."""
        fits = self._by_harmonics(truth, noise) if self.plan is not None else self._by_chain(truth, noise)
        return _packed(truth, *fits)

    def true_readings(self, truth: Array) -> Float[Array, "positions 3 lanes"]:
        """Readings without noise, g; one lane where all instruments are the same."""
        if self.spread is None:
            return jnp.asarray(self.readings)[:, :, None]
        return jax.vmap(lambda vector: self.simulated.at(vector)(self.problem.where), in_axes=1, out_axes=2)(truth)

    def _by_harmonics(self, truth: Array, noise: Array) -> tuple[Array, Array, Array]:
        """Fit the harmonics; the remainder of the readings completes the sum of squares."""
        plan = self.plan
        assert plan is not None
        beyond = None if self.beyond is None else jnp.asarray(self.beyond)[:, :, None]
        if self.spread is None:
            of_truth = plan.harmonics(jnp.asarray(self.readings)[:, :, None])
        elif beyond is None:
            of_truth = nominal_harmonics(materialised(truth), plan.pitch)
            of_truth = materialised(of_truth.reshape(-1, BLOCK)).reshape(of_truth.shape)
        else:
            readings = self.true_readings(truth)
            of_truth = plan.harmonics(readings)
            beyond = readings - plan.synthesis(of_truth)
        of_noise = plan.harmonics(noise)
        fits = fit_harmonics(of_truth + of_noise, plan.pitch, plan.angles)
        explained = jnp.sum(of_noise**2 * plan.weights[None, :, None, None], axis=(0, 1, 2))
        remainder = noise if beyond is None else noise + beyond
        rest = jnp.sum(remainder**2, axis=(0, 1)) - explained
        return fits.values, (fits.sum_of_squares + rest) / self.sd**2, fits.converged

    def _by_chain(self, truth: Array, noise: Array) -> tuple[Array, Array, Array]:
        assert self.shared is not None
        readings = jnp.moveaxis(self.true_readings(truth) + noise, 2, 0)
        fits = fit_chain(self.problem, self.shared, readings)
        return fits.values.T, fits.chi2, fits.converged


def _packed(truth: Array, values: Array, chi2: Array, converged: Array) -> Trials:
    """The block as returned; failed lanes contain finite numbers without meaning."""
    rows = jnp.concatenate([values, chi2[None], jnp.asarray(converged, values.dtype)[None]])
    rows = materialised(jnp.where(jnp.isfinite(rows), rows, 0.0))
    return Trials(truth, rows[:-2], rows[-2], rows[-1] > 0.5)


def materialised(rows: Float[Array, "rows lanes"]) -> Float[Array, "rows lanes"]:
    """The same numbers, put in memory.

    The compiler fuses elementwise work into every consumer and would repeat a whole fit for each of the sums made of
    it; a matrix product (here with 1) is where fusion ends. Its optimisation barrier does not do that on CPUs.
    """
    return jnp.eye(rows.shape[0]) @ rows


def experiment(
    chain: Chain,
    where: Where,
    *,
    sd: float,
    injected: tuple[Link, ...] = (),
    spread: Mapping[str, float] | None = None,
    priors: Priors | None = None,
    covariance: Float[np.ndarray, "3 positions positions"] | None = None,
    path: str = "auto",
) -> Experiment:
    """A simulated calibration.

    **Arguments:**

    - `chain`: the fitted chain, its leaves at their true values.
    - `where`: the positions.
    - `sd`: stated sd of a reading, g.
    - `injected`: links with their coefficients, in the simulated chain only.
    - `spread`: sd of the truth about the chain's values by leaf or parameter name (a new instrument every trial).
    - `priors`: of the fit, (mean, sd) by name.
    - `covariance`: of the position means' noise, per axis, g^2; white with `sd` if omitted.
    - `path`: `"auto"`, `"harmonic"` or `"chain"`.

    **Raises:** `InputError` for unknown names or a plan that leaves parameters undetermined; `ValueError` if the
    harmonic path is requested but does not apply.
    """
    simulated = chain
    for link in injected:
        simulated = simulated + with_known_coefficients(link)
    return experiment_of(
        problem_for(chain, where, sd, priors),
        simulated=simulated,
        spread=None if not spread else spread_of(chain, spread),
        covariance=covariance,
        path=path,
    )


def experiment_of(
    problem: Problem,
    *,
    simulated: Chain | None = None,
    spread: Float[np.ndarray, " free"] | None = None,
    covariance: Float[np.ndarray, "3 positions positions"] | None = None,
    path: str = "auto",
) -> Experiment:
    """A simulated calibration of a problem whose chain is at the truth; arguments as of `experiment`.

    **Arguments:**

    - `simulated`: the chain that makes the readings, with the free vector of the fitted chain; the fitted chain if omitted.
    - `spread`: as of `Experiment`.

    **Raises:** as `experiment`.
    """
    problem, chain = problem.bare, problem.chain
    plan = harmonic_path(problem)
    if path == "harmonic" and isinstance(plan, str):
        raise ValueError(f"the harmonic path does not apply: {plan}")
    reason = plan if isinstance(plan, str) else ("requested" if path == "chain" else "")
    chosen = None if isinstance(plan, str) or path == "chain" else plan
    same = simulated is None or simulated is chain
    simulated = chain if simulated is None else simulated
    readings = np.asarray(simulated(problem.where))
    return Experiment(
        names=chain.names,
        units=chain.units,
        truth=chain.vector,
        spread=spread,
        problem=problem,
        simulated=simulated,
        readings=readings,
        beyond=None if same or chosen is None else _beyond(chosen, readings),
        factor=None if covariance is None else np.stack([_square_root(part) for part in covariance]),
        sd=float(1.0 / np.max(np.abs(np.asarray(problem.whitening)))) if problem.whitening.ndim == 1 else float("nan"),
        covariance=_predicted_covariance(problem),
        path="chain" if chosen is None else "harmonic",
        reason=reason,
        plan=chosen,
        shared=expansion(problem) if chosen is None else None,
    )


def problem_for(chain: Chain, where: Where, sd: float, priors: Priors | None = None) -> Problem:
    """The fit with no readings yet, its settings those of `where` (whose index columns the chain was made with)."""
    readings = np.zeros((len(where.alpha), 3))
    return Problem.from_arrays(chain, where, readings, noise_sd=sd, priors=priors).bare


def _predicted_covariance(problem: Problem) -> np.ndarray:
    """Covariance of the estimates at the chain's own parameters, from the stated noise."""
    _, to_values = design(problem)
    return to_values @ to_values.T


def _beyond(plan: UniformPlan, readings: np.ndarray) -> np.ndarray:
    """The part of readings beyond mean, sine and cosine."""
    return readings - np.asarray(plan.synthesis(plan.harmonics(jnp.asarray(readings)[:, :, None])))[..., 0]


def with_known_coefficients(link: Link) -> Link:
    """`link` with no free leaf, so that the simulated chain's free vector is the fitted chain's."""
    return with_parameters(link, lambda leaf: dataclasses.replace(leaf, free=False))


def spread_of(chain: Chain, spread: Mapping[str, float]) -> Float[np.ndarray, " free"]:
    """Sd of each parameter of random instruments, from sds by leaf or parameter name; 0 for the others.

    **Raises:** `InputError` for a name that the chain lacks.
    """
    members = {leaf.name: leaf.names for leaf in chain.free} | {name: (name,) for name in chain.names}
    sd = np.zeros(len(chain.names))
    for key, size in spread.items():
        if key not in members:
            raise InputError(f"truth.spread.{key}: the model has no such parameter; it has {', '.join(chain.names)}")
        sd[[chain.names.index(name) for name in members[key]]] = size
    return sd


def _square_root(covariance: np.ndarray) -> np.ndarray:
    """A square root of a covariance that may be singular."""
    sizes, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(sizes, 0.0))
