"""Monte Carlo check of a budget: inputs are drawn and each trial is fitted (JCGM 101), without linearisation or normality."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from tumblecal.budget.budget import Budget
from tumblecal.budget.inputs import Input
from tumblecal.estimation.programs import compiler_options
from tumblecal.ground.errors import InputError
from tumblecal.simulation.chain_fit import expansion, fit_chain


# Trials that are fitted at once, and the smallest number of all.
_BLOCK, _FEWEST = 1000, 100


@dataclass(frozen=True)
class MonteCarlo:
    """Statistics of each parameter over the trials: mean shift, sd, half width of the symmetric interval at the budget's level,
    and the share of trials whose error is within U. `failed` trials had no fit and are not included."""

    trials: int
    failed: int
    shift: Float[np.ndarray, " free"]
    sd: Float[np.ndarray, " free"]
    half_width: Float[np.ndarray, " free"]
    within: Float[np.ndarray, " free"]


def monte_carlo(budget: Budget, trials: int, seed: int = 0) -> MonteCarlo:
    """Draw noise and inputs, fit each trial, compare with the input values.

    Inputs that are equal at all positions act through the exact chain; separate ones for each position by their derivatives.
    The noise is drawn from the covariance of the fit, including correlations between positions.

    **Raises:** `InputError` for too few trials.
    """
    if trials < _FEWEST:
        raise InputError(f"--monte-carlo {trials}: at least {_FEWEST} trials")
    problem = replace(budget.fit.problem, chain=budget.fit.chain)
    quick = compiler_options()
    fitted = jax.jit(partial(fit_chain, problem, expansion(problem)), compiler_options=quick)
    readings_at = jax.jit(jax.vmap(lambda vector: budget.chain.at(vector)(problem.where)), compiler_options=quick)
    rng, errors, failed = np.random.default_rng(seed), [], 0
    for first in range(0, trials, _BLOCK):
        count = min(_BLOCK, trials - first)
        vectors, added, direct = _drawn(budget, rng, count)
        noise = problem.noise.sample(rng, count).T.reshape(count, *problem.readings.shape)
        if budget.fit.noise == "estimated":  # an estimated sd with its uncertainty
            noise *= budget.fit.level * np.sqrt(budget.fit.dof / rng.chisquare(budget.fit.dof, (count, 1, 1)))
        fits = fitted(jnp.asarray(np.asarray(readings_at(vectors)) + added + noise))
        good = np.asarray(fits.converged)
        errors.append((np.asarray(fits.values) - budget.fit.values + direct)[good])
        failed += int(np.sum(~good))
    error = np.concatenate(errors)
    within = np.mean(np.abs(error) <= budget.expanded, axis=0)
    half = np.quantile(np.abs(error - error.mean(axis=0)), budget.level, axis=0)
    return MonteCarlo(trials, failed, error.mean(axis=0), error.std(axis=0, ddof=1), half, within)


def _drawn(budget: Budget, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameter vectors of the chain with its inputs, and additions to readings and to estimates."""
    chain, fit = budget.chain, budget.fit
    vectors = np.tile(chain.vector, (count, 1))
    added, direct = np.zeros((count, *fit.problem.readings.shape)), np.zeros((count, len(fit.names)))
    for given in budget.inputs:
        for name in given.names:
            groups = given.groups(fit.problem.where)
            values = given.u * _standard(rng, given, (count, groups.max() + 1))
            if given.direct:
                direct[:, fit.names.index(name)] += values[:, 0]
            elif given.stated.per is None:
                vectors[:, chain.names.index(name)] += values[:, 0]
            else:
                added += values[:, groups, None] * budget.derivatives[name]
    return vectors, added, direct


def _standard(rng: np.random.Generator, given: Input, size: tuple[int, ...]) -> np.ndarray:
    """Draws of an input's distribution, with sd 1 (for finite degrees of freedom Student's t of the stated sd)."""
    drawn, spread = {
        "normal": lambda: (rng.standard_normal(size), 1.0),
        "rectangular": lambda: (rng.uniform(-1, 1, size), 3**0.5),
        "triangular": lambda: (rng.uniform(-1, 1, size) / 2 + rng.uniform(-1, 1, size) / 2, 6**0.5),
        "arcsine": lambda: (np.sin(rng.uniform(0, 2 * np.pi, size)), 2**0.5),
    }[given.stated.distribution]()
    if np.isfinite(given.stated.freedom):
        drawn = drawn * np.sqrt(given.stated.freedom / rng.chisquare(given.stated.freedom, (size[0], 1)))
    return drawn * spread
