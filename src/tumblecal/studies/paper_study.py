"""The paper's section 3: 600 simulated data sets, estimated by every method set by set (its figures 4 to 9)."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from tumblecal.chain import nominal_chain, settings
from tumblecal.chain.plan import grid
from tumblecal.data import PositionSet
from tumblecal.data.paper import SIMULATION_DATA_SETS, SIMULATION_NOISE_G, SIMULATION_TRUTH
from tumblecal.estimation import exact, harmonic, kalman, problem_of
from tumblecal.estimation.kalman import DIFFUSE, Prior
from tumblecal.estimation.programs import compiler_options
from tumblecal.simulation.position_means import position_means


# A prior of the size of the errors themselves: what makes the paper's filter look fast.
INFORMATIVE = Prior(sd=1e-3)
TIGHT = Prior(sd=0.3e-3)
STRETCH = 10

Estimates = Float[np.ndarray, "sets free"]


@dataclass(frozen=True)
class PaperStudy:
    """Estimates after each data set, by method, with the standard deviation that each method claims.

    `single`: least squares of each set alone. `mean`: its running mean. `kalman`: Kalman filter with a prior of 1e-3;
    `diffuse`: the same with a diffuse prior. `exact`: exact fit of each set alone; `exact_mean`: exact fit of the mean
    of the sets so far. `single_sd` is of one set alone. `early_error`: rms error after 1, 2, ... sets, in units of
    `single_sd`, over all parameters and all stretches of `STRETCH` sets: of the running mean and of filters by prior.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    truth: Float[np.ndarray, " free"]
    single: Estimates
    mean: Estimates
    kalman: Estimates
    kalman_sd: Estimates
    diffuse: Estimates
    exact: Estimates
    exact_mean: Estimates
    single_sd: Float[np.ndarray, " free"]
    early_error: dict[str, Float[np.ndarray, " sets"]]
    seed: int

    @property
    def kalman_is_running_mean(self) -> float:
        """Largest difference of the diffuse filter and the running mean, in units of the mean's sd, at any set."""
        count = np.arange(1, len(self.mean) + 1)[:, None]
        return float(np.max(np.abs(self.diffuse - self.mean) * np.sqrt(count) / self.single_sd))

    def settled(self, estimates: Estimates, share: float = 0.5) -> Float[np.ndarray, " free"]:
        """Number of sets after which each parameter stays within `share` of one set's sd of the truth."""
        outside = np.abs(estimates - self.truth) > share * self.single_sd
        last = len(outside) - np.argmax(outside[::-1], axis=0)
        return np.where(outside.any(axis=0), last + 1, 1)


def paper_study(seed: int = 0) -> PaperStudy:
    """Simulate as many data sets as the paper did, and estimate; `seed`: of the noise."""
    sets = SIMULATION_DATA_SETS
    plan = grid([45.0 * place for place in range(8)], [0.0, 45.0, 90.0])
    where = settings(plan.alpha, plan.beta)
    chain = nominal_chain(where)
    truth = np.array([SIMULATION_TRUTH[name] for name in chain.names])
    keys = jax.random.split(jax.random.key(seed), sets)
    instrument = chain.at(truth)
    readings = np.asarray(
        jax.jit(jax.vmap(lambda key: position_means(instrument, where, SIMULATION_NOISE_G, key)))(keys)
    )
    count = np.arange(1, sets + 1)[:, None, None]
    means = np.cumsum(readings, axis=0) / count
    first = PositionSet(plan.names, np.asarray(plan.alpha_deg), np.asarray(plan.beta_deg), readings[0])
    harmonics = harmonic.analyse(problem_of(first))
    gain, noise = harmonic.least_squares_estimator(harmonics), harmonics.covariance * SIMULATION_NOISE_G**2
    z = readings.reshape(sets, -1) @ harmonics.analysis.T - harmonics.ideal
    single = z @ gain.T
    informed, _ = kalman.run(z, harmonics.design, noise, INFORMATIVE)
    diffuse, _ = kalman.run(z, harmonics.design, noise, DIFFUSE)
    each, of_means = _exact(first, readings), _exact(first, means)
    return PaperStudy(
        names=chain.names,
        units=chain.units,
        truth=truth,
        single=single,
        mean=np.cumsum(single, axis=0) / count[:, :, 0],
        kalman=informed.values,
        kalman_sd=informed.sd,
        diffuse=diffuse.values,
        exact=each,
        exact_mean=of_means,
        single_sd=np.sqrt(np.diag(gain @ noise @ gain.T)),
        early_error=_early_error(z, gain, harmonics.design, noise, truth),
        seed=seed,
    )


def _early_error(z: np.ndarray, gain: np.ndarray, design: np.ndarray, noise: np.ndarray, truth: np.ndarray):
    """How far from the truth each method is after few sets, averaged over stretches of the data."""
    scale = np.sqrt(np.diag(gain @ noise @ gain.T))
    count = np.arange(1, STRETCH + 1)[:, None]
    errors: dict[str, list[np.ndarray]] = {"running mean": []}
    for first in range(0, len(z) - STRETCH + 1, STRETCH):
        part = z[first : first + STRETCH]
        errors["running mean"].append((np.cumsum(part @ gain.T, axis=0) / count - truth) / scale)
        for prior in (DIFFUSE, INFORMATIVE, TIGHT):
            history, _ = kalman.run(part, design, noise, prior)
            errors.setdefault(f"Kalman, prior sd {prior.sd:g}", []).append((history.values - truth) / scale)
    return {name: np.sqrt(np.mean(np.square(each), axis=(0, 2))) for name, each in errors.items()}


def _exact(first: PositionSet, readings: np.ndarray) -> Estimates:
    """Exact fits of many data sets in one program."""
    problem = problem_of(first, noise_sd=SIMULATION_NOISE_G)
    start = jnp.asarray(problem.chain.vector)
    # The problem's own readings are replaced, all else is shared. One set after the other: batched linear algebra shared
    # between threads may differ in the last bit from call to call, and a fit on the edge of convergence by a step.
    values, converged, _ = jax.jit(
        lambda every: jax.lax.map(lambda measured: exact.solve(replace(problem, readings=measured), start), every),
        compiler_options=compiler_options(),
    )(readings)
    if not bool(np.all(converged)):
        raise RuntimeError(f"{int(np.sum(~converged))} of {len(readings)} simulated fits did not converge")
    return np.asarray(values)
