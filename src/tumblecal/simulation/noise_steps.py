"""Correlated noise from dwell to dwell, exactly: each part's state at the start of a dwell, its mean over the dwell.

For studies of many data sets in a row, where the covariance of all positions would be too large to factor. State and
mean are jointly Gaussian given the state before; no sample is drawn.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.noise import Dwells, GaussMarkov, Noise, RandomWalk


# A part whose correlation from one dwell to the next is below this is drawn as white dwell means.
FORGOTTEN = 1e-9


class NoiseSteps(eqx.Module):
    """Recursion of S states for each axis: `x' = keep x + a e1`, mean `= reach x + b e1 + c e2`, e1 and e2 white.

    `start` is the sd of the states before the first dwell, `white` the sd of what dwells do not share, g.
    """

    keep: Float[np.ndarray, " states"]
    reach: Float[np.ndarray, " states"]
    step: Float[np.ndarray, "states 3"]
    along: Float[np.ndarray, "states 3"]
    independent: Float[np.ndarray, "states 3"]
    start: Float[np.ndarray, "states 3"]
    white: Float[np.ndarray, "3"]

    def first(self, key: Array, lanes: int) -> Float[Array, "states 3 lanes"]:
        """States before the first dwell."""
        return jnp.asarray(self.start)[:, :, None] * jax.random.normal(key, (*self.start.shape, lanes))

    def dwells(
        self, state: Float[Array, "states 3 lanes"], key: Array, positions: int
    ) -> tuple[Float[Array, "states 3 lanes"], Float[Array, "positions 3 lanes"]]:
        """Means over the next dwells, and the states after them."""
        lanes = state.shape[2]
        white = jnp.asarray(self.white)[None, :, None] * jax.random.normal(
            jax.random.fold_in(key, 0), (positions, 3, lanes)
        )
        if not len(self.keep):
            return state, white

        def one(state, key):
            drawn = jax.random.normal(key, (2, *state.shape))
            mean = self.reach[:, None, None] * state + self.along[:, :, None] * drawn[0]
            mean = jnp.sum(mean + self.independent[:, :, None] * drawn[1], axis=0)
            return self.keep[:, None, None] * state + self.step[:, :, None] * drawn[0], mean

        state, means = jax.lax.scan(one, state, jax.random.split(jax.random.fold_in(key, 1), positions))
        return state, means + white


def noise_steps(noise: Noise, dwells: Dwells) -> NoiseSteps:
    """The recursion for dwells that follow each other evenly.

    **Raises:** `ValueError` for an uneven schedule.
    """
    apart = np.diff(dwells.start_s)
    if np.ptp(apart) > 1e-9 * apart[0]:
        raise ValueError("the dwells must follow each other evenly")
    one, rows = Dwells(np.zeros(1), dwells.samples, dwells.period_s), []
    white = np.zeros(3)
    for part in noise.processes:
        variance_of_mean = part.mean_covariance(one)[:, 0, 0]
        if isinstance(part, GaussMarkov) and apart[0] / part.time_s < -np.log(FORGOTTEN):
            rows.append(_exponential(part, dwells, apart[0], variance_of_mean))
        elif isinstance(part, RandomWalk):
            middle = (dwells.samples - 1) / 2 * dwells.period_s
            rows.append((1.0, 1.0, [part.K**2 * apart[0], part.K**2 * middle, variance_of_mean], np.zeros(3)))
        else:
            white += variance_of_mean
    keep, reach, covariance, start = (np.array(column) for column in zip(*rows, strict=True)) if rows else _NOTHING
    step = np.sqrt(covariance[:, 0])
    along = np.divide(covariance[:, 1], step, out=np.zeros_like(step), where=step > 0)
    independent = np.sqrt(np.maximum(covariance[:, 2] - along**2, 0.0))
    return NoiseSteps(keep, reach, step, along, independent, start, np.sqrt(white))


_NOTHING = np.zeros(0), np.zeros(0), np.zeros((0, 3, 3)), np.zeros((0, 3))


def _exponential(part: GaussMarkov, dwells: Dwells, apart_s: float, variance_of_mean: np.ndarray):
    n, step = dwells.samples, dwells.period_s / part.time_s
    reach = np.expm1(-n * step) / np.expm1(-step) / n
    keep = np.exp(-apart_s / part.time_s)
    # Covariances given the state before: of the next state, of it with the mean, of the mean.
    forward = np.exp(-(apart_s / part.time_s - (n - 1) * step)) * reach
    variance = part.sd**2
    rows = [-np.expm1(-2 * apart_s / part.time_s) * variance, (forward - reach * keep) * variance]
    return keep, reach, [*rows, variance_of_mean - reach**2 * variance], part.sd
