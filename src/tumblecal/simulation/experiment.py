"""One block of trials: draw an instrument and its noise, calibrate, compare with the truth.

Trials are numbered; `BLOCK` of them that start at a multiple of it are always drawn and fitted together by the same
compiled program, with the random key `fold_in(key(seed), block)`. So the bits of a trial depend on its number alone, not
on how many are asked for, in which order, or by how many processes.
"""

import dataclasses
from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from tumblecal.chain import Chain, Link, Where, with_parameters
from tumblecal.chain.head_ability import HeadAbility
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.problem import Problem, require_problem
from tumblecal.estimation.slow_noise import with_slow_noise
from tumblecal.estimation.visits import drawn_with_repeatability, with_repeatability
from tumblecal.ground.errors import InputError
from tumblecal.simulation.chain_fit import Expansion, design, expansion, fit_chain
from tumblecal.simulation.evaluated_once import materialised
from tumblecal.simulation.harmonic_fit import nominal_harmonics
from tumblecal.simulation.samplers import Sampler, check_sampler, draws
from tumblecal.simulation.uniform import UniformPlan, fits_by_harmonics, harmonic_path


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
    - `draw_truth`, `draw_noise`: the user's samplers, in place of truth and spread, and of normal noise.
    - `problem`: the fit, its chain at the truth. `simulated`: the chain that makes the readings, injected effects included.
    - `readings`: its readings at the truth, g; `nominal`: whether they are those of the fitted chain.
    - `factor`: square root of the noise's covariance: sd of each reading (positions, 3), one matrix for each axis, or one.
    - `sd`: the stated sd of a reading, g, of the weights and of the predicted covariance; the smallest if they differ, NaN for
      correlated readings.
    - `covariance`: predicted, of the estimates.
    - `path`: `"harmonic"` (exact harmonics of a uniform plan) or `"chain"`; `reason`: why not the former.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    truth: Float[np.ndarray, " free"]
    spread: Float[np.ndarray, " free"] | None
    draw_truth: Sampler | None = eqx.field(static=True)
    draw_noise: Sampler | None = eqx.field(static=True)
    problem: Problem
    simulated: Chain
    readings: Float[np.ndarray, "positions 3"]
    nominal: bool = eqx.field(static=True)
    factor: Float[np.ndarray, " *shape"]
    sd: float = eqx.field(static=True)
    covariance: Float[np.ndarray, "free free"]
    path: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    plan: UniformPlan | None = eqx.field(static=True)
    shared: Expansion | None

    @property
    def dof(self) -> int:
        """Degrees of freedom of the sum of squares, priors counted as readings."""
        return 3 * int(np.sum(self.problem.takes_part)) + self.problem.priors - len(self.names)

    def noise(self, key: Array) -> Float[Array, "positions 3 lanes"]:
        """Noise of one block, g.

        **Raises:** `InputError` if it is unknown.
        """
        if self.draw_noise is not None:
            return draws(self.draw_noise, jax.random.fold_in(key, 2), BLOCK)
        if not self.problem.known:
            raise InputError("the noise is unknown: give a sampler, or a problem with a stated noise")
        white, factor = jax.random.normal(key, (*self.readings.shape, BLOCK)), jnp.asarray(self.factor)
        if factor.shape == self.readings.shape:
            return factor[:, :, None] * white
        if factor.ndim == 3:
            return jnp.einsum("apq,qal->pal", factor, white)
        return (factor @ white.reshape(-1, BLOCK)).reshape(white.shape)

    def trials(self, seed: int | Array, block: int | Int[Array, ""]) -> Trials:
        """Trials `block * BLOCK` to `(block + 1) * BLOCK - 1`; pure, to be compiled."""
        key = jax.random.fold_in(jax.random.key(seed), block)
        return self.calibrated(self.instruments(key), self.noise(key))

    def instruments(self, key: Array) -> Float[Array, "free lanes"]:
        """True parameters of one block."""
        if self.draw_truth is not None:
            return draws(self.draw_truth, jax.random.fold_in(key, 1), BLOCK)
        if self.spread is None:
            return jnp.broadcast_to(jnp.asarray(self.truth)[:, None], (len(self.truth), BLOCK))
        drawn = jax.random.normal(jax.random.fold_in(key, 1), (len(self.truth), BLOCK))
        return jnp.asarray(self.truth)[:, None] + self.spread[:, None] * drawn

    def calibrated(self, truth: Float[Array, "free lanes"], noise: Float[Array, "positions 3 lanes"]) -> Trials:
        """Estimates from readings of these instruments with this noise, g."""
        values, chi2, converged = self.fits(self.true_readings(truth) + noise)
        rows = jnp.concatenate([values, chi2[None], jnp.asarray(converged, values.dtype)[None]])
        # Failed lanes contain finite numbers without meaning.
        rows = materialised(jnp.where(jnp.isfinite(rows), rows, 0.0))
        return Trials(truth, rows[:-2], rows[-2], rows[-1] > 0.5)

    @property
    def one_instrument(self) -> bool:
        """Whether all trials have the same true parameters."""
        return self.spread is None and self.draw_truth is None

    def true_readings(self, truth: Array) -> Float[Array, "positions 3 lanes"]:
        """Readings without noise, g; one lane where all instruments are the same."""
        if self.one_instrument:
            return jnp.asarray(self.readings)[:, :, None]
        if self.plan is None or not self.nominal:
            return jax.vmap(lambda vector: self.simulated.at(vector)(self.problem.where), in_axes=1, out_axes=2)(truth)
        harmonics = nominal_harmonics(materialised(truth), self.plan.pitch)
        return self.plan.synthesis(materialised(harmonics.reshape(-1, BLOCK)).reshape(harmonics.shape))

    def fits(self, readings: Float[Array, "positions 3 lanes"]) -> tuple[Array, Array, Array]:
        """Values (free, lanes), sums of squares and convergence from readings, g."""
        if self.plan is not None:
            return fits_by_harmonics(self.plan, self.sd, readings)
        assert self.shared is not None
        fits = fit_chain(self.problem, self.shared, jnp.moveaxis(readings, 2, 0))
        return fits.values.T, fits.chi2, fits.converged


def experiment(
    chain: Chain,
    where: Where,
    *,
    sd: float,
    injected: tuple[Link, ...] = (),
    spread: Mapping[str, float] | None = None,
    priors: Priors | None = None,
    covariance: Float[np.ndarray, "3 positions positions"] | None = None,
    ability: HeadAbility | None = None,
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
    - `covariance`: of the position means' noise, per axis, g^2, which the fit takes for white; white with `sd` if omitted.
    - `ability`: of the head. Its slow noise is drawn, and a part of the fit's noise, unless `covariance` is given; errors of
      settings that are set again are drawn with its repeatability, and have it in their priors.
    - `path`: `"auto"`, `"harmonic"` or `"chain"`.

    **Raises:** `InputError` for unknown names or a plan that leaves parameters undetermined; `ValueError` if the
    harmonic path is requested but does not apply.
    """
    simulated = chain
    for link in injected:
        simulated = simulated + with_known_coefficients(link)
    own = None if not spread else spread_of(chain, spread)
    if ability is None:
        return experiment_of(
            problem_for(chain, where, sd, priors), simulated=simulated, spread=own, covariance=covariance, path=path
        )
    priors = with_repeatability(priors or {}, ability.repeatability, chain, where)
    problem = _without_readings(chain, where, sd, priors)
    problem = with_slow_noise(problem, ability) if covariance is None else problem
    drawn = drawn_with_repeatability(
        chain.vector, np.zeros(len(chain.names)) if own is None else own, ability.repeatability, chain, where
    )
    draw = None if drawn is None else partial(_drawn, *drawn)
    made = experiment_of(problem, simulated=simulated, spread=own, draw_truth=draw, covariance=covariance, path=path)
    return dataclasses.replace(made, sd=sd)


def experiment_of(
    problem: Problem,
    *,
    simulated: Chain | None = None,
    spread: Float[np.ndarray, " free"] | None = None,
    covariance: Float[np.ndarray, "3 positions positions"] | None = None,
    draw_truth: Sampler | None = None,
    draw_noise: Sampler | None = None,
    path: str = "auto",
) -> Experiment:
    """A simulated calibration of a problem whose chain is at the truth; arguments as of `experiment`.

    **Arguments:**

    - `simulated`: the chain that makes the readings, with the free vector of the fitted chain; the fitted chain if omitted.
    - `spread`, `draw_truth`, `draw_noise`: as of `Experiment`.

    **Raises:** as `experiment`; `InputError` for an unknown `path`, or a sampler that is not a function of its key alone.
    """
    require_problem(problem, "this function")
    if path not in ("auto", "harmonic", "chain"):
        raise InputError(f"path {path!r}: the paths are 'auto', 'harmonic' and 'chain'")
    problem, chain = problem.bare, problem.chain
    plan = harmonic_path(problem)
    if path == "harmonic" and isinstance(plan, str):
        raise ValueError(f"the harmonic path does not apply: {plan}")
    reason = plan if isinstance(plan, str) else ("requested" if path == "chain" else "")
    chosen = None if isinstance(plan, str) or path == "chain" else plan
    simulated, whitening = chain if simulated is None else simulated, np.asarray(problem.whitening)
    readings = np.asarray(simulated(problem.where))
    factor = np.linalg.inv(whitening) if whitening.ndim > 1 else 1.0 / whitening.reshape(readings.shape)
    check_sampler(draw_truth, chain.vector.shape, "truth")
    check_sampler(draw_noise, readings.shape, "noise")
    # Covariance of the estimates at the chain's own parameters, from the stated noise.
    _, to_values = design(problem)
    predicted_covariance = to_values @ to_values.T
    return Experiment(
        names=chain.names,
        units=chain.units,
        truth=chain.vector,
        spread=spread,
        draw_truth=draw_truth,
        draw_noise=draw_noise,
        problem=problem,
        simulated=simulated,
        readings=readings,
        nominal=simulated is chain,
        factor=factor if covariance is None else np.stack([square_root(part) for part in covariance]),
        sd=float(1.0 / np.max(np.abs(whitening))) if whitening.ndim == 1 else float("nan"),
        covariance=predicted_covariance,
        path="chain" if chosen is None else "harmonic",
        reason=reason,
        plan=chosen,
        shared=expansion(problem) if chosen is None else None,
    )


def problem_for(chain: Chain, where: Where, sd: float, priors: Priors | None = None) -> Problem:
    """The fit with no readings yet, its settings those of `where` (whose index columns the chain was made with)."""
    return _without_readings(chain, where, sd, priors).bare


def _without_readings(chain: Chain, where: Where, sd: float, priors: Priors | None) -> Problem:
    readings = np.zeros((len(where.alpha), 3))
    return Problem.from_arrays(chain, where, readings, noise_sd=sd, priors=priors)


def _drawn(mean: np.ndarray, root: np.ndarray, key: Array) -> Array:
    """A random instrument."""
    return jnp.asarray(mean) + jnp.asarray(root) @ jax.random.normal(key, (root.shape[1],))


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


def square_root(covariance: np.ndarray) -> np.ndarray:
    """A square root of a covariance that may be singular."""
    sizes, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(sizes, 0.0))
