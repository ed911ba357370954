"""The slow noise that a rig states (`[head.noise]`) in the covariance of a problem: for every command that uses a rig."""

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.where import Where
from tumblecal.estimation.problem import Problem
from tumblecal.noise.covariance import Covariance
from tumblecal.noise.of_head import slow_covariance
from tumblecal.noise.recorded import against_neighbours


def slow_noise_of(ability: HeadAbility | None, where: Where) -> Float[np.ndarray, "3 positions positions"] | None:
    """Covariance of the slow noise of some positions, g^2; None if none is stated, or the times of the positions are unknown.

    If the times are from several clocks, the noise starts again with each clock: the pause between them is unknown.
    """
    if ability is None or not ability.slow_noise.any or where.time_s is None:
        return None
    time = np.asarray(where.time_s, float)
    clock = np.asarray(where.index("clock")) if where.clocks > 1 else np.zeros(len(time), int)
    total = np.zeros((3, len(time), len(time)))
    for number in np.unique(clock):
        rows = np.flatnonzero(clock == number)
        total[np.ix_(np.arange(3), rows, rows)] = slow_covariance(ability.slow_noise, ability.times, time[rows])
    return total


def with_slow_noise(problem: Problem, ability: HeadAbility | None) -> Problem:
    """A problem of independent readings with stated noise, under the slow noise of a head in addition."""
    slow = None if not problem.known else slow_noise_of(ability, problem.where)
    if slow is None:
        return problem
    variances = problem.noise.values.reshape(-1, 3)
    total = slow + np.stack([np.diag(of_axis) for of_axis in variances.T])
    sd = np.sqrt(against_neighbours(total, np.asarray(problem.where.time_s))) if len(variances) > 1 else None
    return problem.with_noise(Covariance.by_axis(total), known=True, sd=sd)
