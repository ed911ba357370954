"""The noise level for the uncertainties of a fit: the stated one, or the one estimated from the residuals.

A stated standard deviation, from sd columns or for all readings, is used unless the residuals contradict it. If they
do, in either direction (chi-square, probability 0.001 each), only the relative weights of the readings are used:
their level is estimated from the residuals, and intervals use Student's t. If sd columns are too small, a floor added
in quadrature is tried first (`between_position_sd`).
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from tumblecal.estimation.contradicted import residual_of_readings
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.problem import Problem
from tumblecal.ground.numbers_shown import p_words
from tumblecal.noise.covariance import Covariance


# Tail probability of chi-square below which the residuals contradict the stated noise.
UNLIKELY = 0.001
# With fewer degrees of freedom the stated level is used: an estimated level would be less certain.
_LEAST_DOF = 5


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
        return (
            f"The residuals contradict the stated noise (sd {self.stated_g * 1e3:.2g} mg; chi2/dof {self.ratio:.3g}, "
            f"{p_words(self.p_value)}). The uncertainties use the level estimated "
            f"from the residuals: sd {self.factor * self.stated_g * 1e3:.2g} mg, Student's t"
        )

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
