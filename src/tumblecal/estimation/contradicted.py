"""What the rest of a fit contradicts: a single reading, and the priors that were stated."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import special

from tumblecal.estimation.fit import Fit
from tumblecal.ground.axes import AXES


# Directions that the data see by less than this share of the best seen are left to the priors.
_SEEN = 1e-9


class OutlyingReading(NamedTuple):
    """The reading farthest from the fit to all others, in sd of what it leaves; `p_value`: that any would be so far."""

    position: str
    axis: str
    sds: float
    p_value: float


def outlying_reading(fit: Fit) -> OutlyingReading | None:
    """The largest studentized residual; None where the degrees of freedom are too few, or every reading is met exactly.

    Externally studentized where the noise is estimated (Student's t, one degree of freedom less), standardized where it is
    stated; Bonferroni over all readings (Cook and Weisberg 1982, section 2.2).
    """
    readings = fit.problem.readings.size
    if fit.dof < 3 or len(fit.rows) < readings or fit.problem.correlated:
        return None
    white, free = fit.rows[:readings], 1.0 - _leverages(fit.jacobian)[:readings]
    seen = (free > 1e-6) & np.repeat(fit.kept, 3)
    if not np.any(white[seen]):
        return None
    square = np.where(seen, white**2 / np.where(seen, free, 1.0), 0.0)
    variance = np.ones(readings) if fit.problem.known else np.maximum(fit.chi2 - square, 1e-300) / (fit.dof - 1)
    sds = np.sqrt(square / variance)
    farthest = int(np.argmax(sds))
    tail = special.ndtr(-sds[farthest]) if fit.problem.known else special.stdtr(fit.dof - 1, -sds[farthest])
    position, axis = divmod(farthest, 3)
    p_value = min(1.0, 2.0 * float(tail) * int(np.sum(seen)))
    return OutlyingReading(fit.data.names[position], AXES[axis], float(sds[farthest]), p_value)


def priors_p_value(fit: Fit) -> float | None:
    """The p-value of all stated priors together against the data: how much the fit without them leaves less, chi-square with as
    many degrees of freedom as directions are both stated and seen; None where there are none, or the noise is not stated."""
    readings = fit.problem.readings.size
    if not (fit.problem.known and fit.problem.with_prior) or len(fit.rows) <= readings:
        return None
    rows, jacobian = fit.rows[:readings], fit.jacobian[:readings]
    seen, both = _column_space(jacobian), _column_space(fit.jacobian)
    stated = fit.problem.priors - (both.shape[1] - seen.shape[1])
    if stated <= 0:
        return None
    # With the priors the fit stands where both balance; without them it would leave what is orthogonal to the Jacobian.
    explained = float(fit.rows @ fit.rows) - float(rows @ rows - np.sum((seen.T @ rows) ** 2))
    return float(special.chdtrc(stated, max(explained, 0.0)))


def residual_of_readings(fit: Fit) -> tuple[float, int]:
    """Chi-square of the readings with all priors disregarded, and its degrees of freedom."""
    readings = fit.problem.readings.size
    rows, seen = fit.rows[:readings], _column_space(fit.jacobian[:readings])
    chi2 = float(rows @ rows - np.sum((seen.T @ rows) ** 2))
    return max(chi2, 0.0), 3 * int(np.sum(fit.kept)) - seen.shape[1]


def _column_space(jacobian: Float[np.ndarray, "rows parameters"]) -> Float[np.ndarray, "rows rank"]:
    left, singular, _ = np.linalg.svd(jacobian, full_matrices=False)
    return left[:, singular > _SEEN * singular[0]]


def _leverages(jacobian: Float[np.ndarray, "rows parameters"]) -> Float[np.ndarray, " rows"]:
    return np.sum(_column_space(jacobian) ** 2, axis=1)
