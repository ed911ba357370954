"""Which noise level a fit's uncertainties use: the stated one, or the one that the residuals show.

A stated standard deviation, by sd columns or for all readings, is used as long as the residuals do not contradict it. If they
do, in either direction (chi-square, one chance in a thousand each), only the relative weights of the readings are kept: their
level is estimated from the residuals, and intervals use Student's t. If sd columns are too small, a floor that is added in
quadrature is tried first (`between_position_sd`).
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from tumblecal.estimation.contradicted import residual_of_readings
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.problem import Problem
from tumblecal.ground.numbers_shown import p_words
from tumblecal.noise.covariance import Covariance


# Chi-square beyond this tail: the residuals are not what the stated noise makes.
UNLIKELY = 0.001
# With fewer degrees of freedom the stated level is kept: an estimated one would be worth less.
_LEAST_DOF = 5


@dataclass(frozen=True)
class ContradictedLevel:
    """A stated noise level that the residuals contradict.

    - `ratio`: chi-square of the readings by its degrees of freedom under the stated noise. `p_value`: of a chi-square at least
      so far from it, to its own side. `stated_g`: the median stated standard deviation, g.
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
        """By which the stated standard deviations are multiplied."""
        return float(np.sqrt(self.ratio))

    @property
    def words(self) -> str:
        """Which level is used, and why."""
        return (
            f"The residuals contradict the stated noise (sd {self.stated_g * 1e3:.2g} mg; chi2/dof {self.ratio:.3g}, "
            f"{p_words(self.p_value)}). The uncertainties use the level that the "
            f"residuals show: sd {self.factor * self.stated_g * 1e3:.2g} mg, Student's t"
        )

    def applied(self, problem: Problem) -> Problem:
        """The problem at the level that the residuals show; it counts as estimated."""
        return problem.with_noise(Covariance.of_sd(self.factor * problem.sd), known=False)


def contradicted_level(fit: Fit) -> ContradictedLevel | None:
    """The stated level of an exact fit, if its residuals contradict it; None if they do not, if no level was stated, and if the
    noise is that of a recording, which states how large slow noise may be, not how large it is."""
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
