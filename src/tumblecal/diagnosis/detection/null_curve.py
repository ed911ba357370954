"""The null distribution of the global test, by one curve for all plans.

The statistic is the logarithm of a weighted mean of Bayes factors. If nothing is wrong, `log P(statistic > s)` is
a(s) + b(s) / nu for nu degrees of freedom, with one b for a known and one for an unknown noise; `benchmarks/null_curve.py` fits
and tests it. Where the weights sum to less, the statistic is smaller by the logarithm. A Bayes factor has the mean one, so
Ville's inequality, P <= exp(-s), is a bound.
"""

import numpy as np
from jaxtyping import Float


_STATISTIC = np.array([-3.2, -2.9, -2.7, -2.4, -2.0, -1.4, -0.6, 0.2, 1.0, 2.2, 4.0, 7.0])
_LIMIT = np.array([0.0, -0.04, -0.28, -0.9, -1.78, -2.87, -4.07, -5.05, -5.99, -7.32, -9.24, -12.44])
_KNOWN = np.array([0.0, 0.0, 1.22, 2.44, 5.43, 7.69, 8.99, 7.05, 6.33, 5.0, 5.0, 5.0])
_UNKNOWN = np.array([0.0, 0.0, 4.47, 9.6, 12.65, 13.87, 15.21, 15.05, 16.42, 15.62, 16.54, 17.94])
# The slope of the logarithm beyond the table, and the sum of the weights that it was fitted with.
_SLOPE, _WEIGHT = -1.1, 1.22
_GRID = np.linspace(-6.0, 30.0, 3601)


def log_p_value(
    statistic: Float[np.ndarray, " *shape"], dof: int, known: bool, weight: float
) -> Float[np.ndarray, " *shape"]:
    """Logarithm of the probability of a larger statistic if nothing is wrong.

    **Arguments:**

    - `dof`: dimension of the residual space. `known`: whether the level of the noise is.
    - `weight`: sum of the weights of all that is tested.
    """
    log_p = np.minimum.accumulate(np.minimum(_LIMIT + (_KNOWN if known else _UNKNOWN) / dof, 0.0))
    shifted = np.asarray(statistic) - np.log(weight / _WEIGHT)
    value = np.interp(shifted, _STATISTIC, log_p) + _SLOPE * np.maximum(shifted - _STATISTIC[-1], 0.0)
    return np.minimum(value, -np.maximum(np.asarray(statistic) - np.log(weight), 0.0))


def threshold(size: float, dof: int, known: bool, weight: float) -> float:
    """The statistic that data without errors exceed with this probability; arguments as of `log_p_value`."""
    return float(np.interp(-np.log(size), -log_p_value(_GRID, dof, known, weight), _GRID))
