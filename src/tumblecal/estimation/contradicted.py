"""Whether the data contradict the stated noise or the stated priors.

A stated standard deviation, from sd columns or for all readings, is used unless the residuals contradict it. If they
do, in either direction (chi-square, probability 0.001 each), only the relative weights of the readings are used:
their level is estimated from the residuals, and intervals use Student's t. If sd columns are too small, a floor added
in quadrature is tried first (`between_position_sd`).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import special

from tumblecal.estimation.fit import Fit
from tumblecal.estimation.problem import Problem
from tumblecal.noise.covariance import Covariance
from tumblecal.words import sentence


# Directions with a singular value below this share of the largest are determined by the priors alone.
_RANK = 1e-9
# Tail probability of chi-square below which the residuals contradict the stated noise.
UNLIKELY = 0.001
# With fewer degrees of freedom the stated level is used: an estimated level would be less certain.
_LEAST_DOF = 5


def priors_p_value(fit: Fit) -> float | None:
    """The p-value of all stated priors together, tested against the data.

    The statistic is the increase of the sum of squares by the priors: chi-square, with one degree of freedom for each direction
    that both priors and data determine. None if there is no such direction, or if the noise is not stated.
    """
    readings = fit.problem.readings.size
    if not (fit.problem.known and fit.problem.with_prior) or len(fit.rows) <= readings:
        return None
    rows, jacobian = fit.rows[:readings], fit.jacobian[:readings]
    seen, both = column_space(jacobian), column_space(fit.jacobian)
    stated = fit.problem.priors - (both.shape[1] - seen.shape[1])
    if stated <= 0:
        return None
    # Without the priors the residual would be the part of the rows orthogonal to the Jacobian of the readings.
    explained = float(fit.rows @ fit.rows) - float(rows @ rows - np.sum((seen.T @ rows) ** 2))
    return float(special.chdtrc(stated, max(explained, 0.0)))


def residual_of_readings(fit: Fit) -> tuple[float, int]:
    """Chi-square of the readings without the priors, and its degrees of freedom."""
    readings = fit.problem.readings.size
    rows, seen = fit.rows[:readings], column_space(fit.jacobian[:readings])
    chi2 = float(rows @ rows - np.sum((seen.T @ rows) ** 2))
    return max(chi2, 0.0), 3 * int(np.sum(fit.retained)) - seen.shape[1]


def dof_of_readings(fit: Fit) -> int:
    """Degrees of freedom of the residuals without the priors, because priors alone test no model."""
    return residual_of_readings(fit)[1] if fit.problem.with_prior else fit.dof


def column_space(jacobian: Float[np.ndarray, "rows parameters"]) -> Float[np.ndarray, "rows rank"]:
    """Orthonormal basis of the column space of a Jacobian of white rows."""
    vectors, singular, _ = np.linalg.svd(jacobian, full_matrices=False)
    return vectors[:, singular > _RANK * singular[0]]


@dataclass(frozen=True)
class ContradictedLevel:
    """A stated noise level that the residuals contradict.

    - `ratio`: chi-square of the readings over its degrees of freedom, under the stated noise. `p_value`: one-sided
      probability of a chi-square at least as extreme. `stated_g`: the median stated standard deviation, g.
    """

    ratio: float
    p_value: float
    stated_g: float

    @property
    def too_small(self) -> bool:
        """Whether the residuals are larger than the stated noise allows."""
        return self.ratio > 1.0

    @property
    def factor(self) -> float:
        """Factor by which the stated standard deviations are multiplied."""
        return float(np.sqrt(self.ratio))

    @property
    def words(self) -> str:
        """The level in use, and the reason."""
        return sentence("noise/level", n=self)

    def applied(self, problem: Problem) -> Problem:
        """The problem at the level estimated from the residuals."""
        return problem.with_noise(Covariance.of_sd(self.factor * problem.sd), known=False)


def contradicted_level(fit: Fit) -> ContradictedLevel | None:
    """The stated level of an exact fit that its residuals contradict; None if they do not contradict it, or if no
    level was stated.

    None also for the noise of a recording, which gives an upper limit of slow noise, not its size.
    """
    problem = fit.problem
    if not problem.known or problem.correlated or not fit.code.good:
        return None
    chi2, dof = residual_of_readings(fit)
    if dof < _LEAST_DOF or fit.computed:
        return None
    larger, smaller = float(special.chdtrc(dof, chi2)), float(special.chdtr(dof, chi2))
    if min(larger, smaller) >= UNLIKELY:
        return None
    return ContradictedLevel(chi2 / dof, min(larger, smaller), float(np.median(problem.sd)))
