"""Effective degrees of freedom (Welch-Satterthwaite) and coverage factors (Student's t): JCGM 100, G.4."""

import numpy as np
from jaxtyping import Float
from scipy.special import stdtrit


# Above this Student's t equals a normal distribution in all stated digits.
_MANY = 1e9


def effective_dof(
    sizes: Float[np.ndarray, "contributions parameters"], dof: Float[np.ndarray, " contributions"]
) -> Float[np.ndarray, " parameters"]:
    """Effective degrees of freedom of combined standard uncertainties; infinite if all contributions have
    infinitely many.

    **Arguments:**

    - `sizes`: standard uncertainty of each parameter by each contribution. `dof`: of each contribution.
    """
    combined, spent = np.sum(sizes**2, axis=0), np.sum(sizes**4 / dof[:, None], axis=0)
    return np.divide(combined**2, spent, out=np.full(len(combined), np.inf), where=spent > 0)


def coverage_factors(dof: Float[np.ndarray, " parameters"], level: float) -> Float[np.ndarray, " parameters"]:
    """Coverage factors for degrees of freedom; `level`: coverage probability of the two-sided interval."""
    return np.asarray(stdtrit(np.minimum(dof, _MANY), 0.5 + level / 2))
