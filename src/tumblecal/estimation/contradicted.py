"""Whether the data contradict the priors that were stated."""

import numpy as np
from jaxtyping import Float
from scipy import special

from tumblecal.estimation.fit import Fit


# Directions with a singular value below this share of the largest are determined by the priors alone.
_RANK = 1e-9


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
