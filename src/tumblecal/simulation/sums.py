"""Sums over the trials of a study, from which every statistic follows, independent of the number of trials.

Sums over the lanes of a block are taken by halving, so that their bits do not depend on threads.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.special import gammaincinv, ndtri, stdtrit

from tumblecal.simulation.evaluated_once import materialised
from tumblecal.simulation.experiment import BLOCK, Experiment, Trials


LEVELS = (0.68, 0.95, 0.99)
# Bins of equal probability of the sum of squares under the stated noise.
CHI2_BINS = 20


class Sums(NamedTuple):
    """Sums over converged trials; errors are estimate minus truth in predicted standard deviations.

    `covered`: trials whose interval contains the true value, by level, with stated and with estimated noise. `below`: trials
    whose sum of squares is below each inner edge of `CHI2_BINS` bins of equal probability.
    """

    trials: Float[Array, ""]
    failed: Float[Array, ""]
    error: Float[Array, " free"]
    products: Float[Array, "free free"]
    covered: Float[Array, "kinds levels free"]
    chi2: Float[Array, ""]
    chi2_squared: Float[Array, ""]
    nees: Float[Array, ""]
    nees_squared: Float[Array, ""]
    below: Float[Array, " edges"]


def halved(values: Float[Array, "*rows lanes"]) -> Float[Array, "*rows"]:
    """Sum over the last axis (a power of two long) by adding its halves."""
    while values.shape[-1] > 1:
        middle = values.shape[-1] // 2
        values = values[..., :middle] + values[..., middle:]
    return values[..., 0]


def sums_of(trials: Trials, experiment: Experiment, wanted: Bool[Array, " lanes"] | None = None) -> Sums:
    """The sums of the wanted lanes of one block; lanes that failed are counted and enter nothing else."""
    wanted = jnp.ones_like(trials.converged) if wanted is None else wanted
    good = trials.converged & wanted
    sd = np.sqrt(np.diag(experiment.covariance))
    dof = experiment.dof
    # A failed lane may contain NaN: replace, not multiply.
    error = materialised(jnp.where(good[None], (trials.values - trials.truth) / sd[:, None], 0.0))
    chi2 = jnp.where(good, trials.chi2, 0.0)
    whitening = np.linalg.inv(np.linalg.cholesky(experiment.covariance / np.outer(sd, sd)))
    nees = jnp.sum((whitening @ error) ** 2, axis=0)
    size = jnp.abs(error)
    scale = jnp.sqrt(chi2 / dof)
    stated = [size <= ndtri(0.5 + level / 2) for level in LEVELS]
    estimated = [size <= stdtrit(dof, 0.5 + level / 2) * scale[None] for level in LEVELS]
    covered = jnp.stack([jnp.stack(stated), jnp.stack(estimated)]) & good[None, None, None]
    edges = 2.0 * gammaincinv(dof / 2.0, np.arange(1, CHI2_BINS) / CHI2_BINS)
    below = (chi2[None] < edges[:, None]) & good[None]
    products = error[:, None, :] * error[None, :, :]
    return Sums(
        trials=halved(jnp.asarray(wanted, error.dtype)),
        failed=halved(jnp.asarray(wanted & ~trials.converged, error.dtype)),
        error=halved(error),
        products=halved(products),
        covered=halved(jnp.asarray(covered, error.dtype)),
        chi2=halved(chi2),
        chi2_squared=halved(chi2**2),
        nees=halved(nees),
        nees_squared=halved(nees**2),
        below=halved(jnp.asarray(below, error.dtype)),
    )


def added(first: Sums, second: Sums) -> Sums:
    """Both together."""
    return Sums(*(one + other for one, other in zip(first, second, strict=True)))


def chunk_sums(experiment: Experiment, seed: int):
    """A compiled function: sums of the trials from `first` (a multiple of `BLOCK`) to before `last`.

    One block is in memory at a time, so that the memory needed does not depend on the number of trials.
    """

    def of_block(block, last):
        wanted = block * BLOCK + jnp.arange(BLOCK) < last
        return sums_of(experiment.trials(seed, block), experiment, wanted)

    def run(first, last):
        shapes = jax.eval_shape(of_block, first, last)
        nothing = jax.tree.map(lambda part: jnp.zeros(part.shape, part.dtype), shapes)
        blocks = first // BLOCK, (last + BLOCK - 1) // BLOCK
        return jax.lax.fori_loop(*blocks, lambda block, total: added(total, of_block(block, last)), nothing)

    return jax.jit(run)
