"""Influence of the undetermined coefficients of a fitted effect on the parameters.

An effect of several coefficients `c` may have directions `h` that the nominal parameters absorb. A fit keeps them at zero, and
their true size changes the estimate by `J+ J_h t - h t`, `J+` the pseudo-inverse of the fitted columns and `t` the unknown
size (the estimation bias by an omitted variable). All coefficients of an effect, in their typical sizes, are treated as draws
of one normal distribution of unknown width (flat in its logarithm). Given the `r` determined directions, `t / s` follows
Student's t with `r` degrees of freedom, `s` the root mean square of the determined ones (Gelman et al., Bayesian Data
Analysis, section 3.2).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri, stdtrit

from tumblecal.diagnosis.causes.cause import Cause


# At this level the interval of a normal distribution of the stated width is that of Student's t.
_LEVEL = 0.95
# Directions of coefficients that are fitted have singular values of 1.
_FITTED = 0.5


def fitted_and_hidden(
    cause: Cause, directions: Float[np.ndarray, "full moved"]
) -> tuple[Float[np.ndarray, "own fitted"], Float[np.ndarray, "own hidden"]]:
    """Orthonormal bases of the directions of a cause's coefficients that are fitted, and of those that are not.

    **Arguments:**

    - `directions`: those that are fitted, of the scaled full vector.
    """
    fitted = directions[list(cause.slot.columns)]
    turned, singular, _ = np.linalg.svd(fitted[:, np.any(fitted, axis=0)])
    count = int(np.sum(singular > _FITTED))
    return turned[:, :count], turned[:, count:]


def widening(dof: float, level: float) -> float:
    """The quantile of Student's t by that of the normal distribution, for intervals of a probability `level`."""
    return float(stdtrit(dof, 0.5 + level / 2) / ndtri(0.5 + level / 2))


def hidden_shifts(
    causes: Sequence[Cause],
    directions: Float[np.ndarray, "full moved"],
    sizes: Float[np.ndarray, " full"],
    covariance: Float[np.ndarray, "moved moved"],
    whole: Float[np.ndarray, "rows full"],
    estimator: Float[np.ndarray, "moved rows"],
) -> Float[np.ndarray, "full hidden"]:
    """Shift of the full vector by one standard deviation of each coefficient direction that is not fitted, scaled.

    **Arguments:**

    - `directions`: those that are fitted, of the scaled full vector. `sizes`: the full vector, scaled.
    - `covariance`: of the fitted, by the noise alone. `whole`: white Jacobian by the scaled full vector.
    - `estimator`: estimate of the fitted directions from the white rows.
    """
    shifts = [np.zeros((len(sizes), 0))]
    for cause in causes:
        own = list(cause.slot.columns)
        seen, hidden = fitted_and_hidden(cause, directions)
        shown = seen.shape[1]
        if not 0 < shown < len(own):
            continue
        spread = seen.T @ directions[own]
        square = np.sum((seen.T @ sizes[own]) ** 2) + np.trace(spread @ covariance @ spread.T)
        moved = directions @ (estimator @ (whole[:, own] @ hidden))
        moved[own] -= hidden
        shifts.append(widening(shown, _LEVEL) * np.sqrt(square / shown) * moved)
    return np.hstack(shifts)
