"""Covariances of noise that is not white: coloured in time, scatter of the attitude."""

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.estimation.problem import Problem
from tumblecal.noise.covariance import Covariance


def coloured(time: Float[np.ndarray, " positions"], correlation: float) -> Covariance:
    """Exponentially correlated noise, the same for each axis, variance one; time in steps."""
    return Covariance(np.exp(np.log(correlation) * np.abs(time[:, None] - time[None, :])), "between")


def across(at: Tangent) -> Float[np.ndarray, "positions 3 3"]:
    """Directions of the dispersion caused by that of a position's attitude.

    A small rotation w moves the reading by w x f: for any distribution about the vertical, the error is perpendicular to f, of
    the same variance in both directions.
    """
    f = at.evaluation.inputs
    return np.sum(f**2, axis=1)[:, None, None] * np.eye(3) - f[:, :, None] * f[:, None, :]


def attitude(across: Float[np.ndarray, "positions 3 3"], problem: Problem, scatter: float) -> Covariance:
    """Covariance of the white rows where every position's attitude is in error by a random rotation of this sd (rad, for g =
    1), and white noise of variance one."""
    blocks = across * scatter**2
    if problem.correlated:
        whitening, count = problem.whitening_matrix, problem.readings.size
        return Covariance(whitening @ Covariance(blocks, "blocks").matrix @ whitening.T + np.eye(count), "full")
    weights = 1.0 / problem.sd
    return Covariance(blocks * weights[:, :, None] * weights[:, None, :] + np.eye(3), "blocks")
