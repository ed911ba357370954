"""Standard deviations of means of few samples: each is uncertain, but all positions of an axis together determine them.

The standard deviation of five samples is in error by a third. Used unchanged it doubles chi-square of a correct model, gives
random weights, and makes intervals too short. Empirical Bayes (Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3, 3) combines each
variance with those of the other positions as far as they agree. If they differ no more than so few samples allow, all get
their mean; if positions really differ, each keeps its variance.
"""

import numpy as np
from jaxtyping import Float
from scipy.optimize import newton
from scipy.special import digamma, polygamma


# With more samples the standard deviation is known to a tenth, and is used unchanged.
FEW = 50
# Excess dispersion, in its standard deviations, up to which the variances agree.
_AGREE = 2.0


def of_few(n: Float[np.ndarray, " positions"]) -> bool:
    """Whether sd columns are from few samples: two or more for each position, and `FEW` or less for half of them."""
    return len(n) > 1 and bool(np.min(n) >= 2 and np.median(n) <= FEW)


def moderated(
    sd: Float[np.ndarray, "positions 3"], n: Float[np.ndarray, " positions"]
) -> Float[np.ndarray, "positions 3"]:
    """Standard deviations of means, g, moderated by those of all positions; `n`: samples of each position, two or more."""
    variances, dof = sd**2 * n[:, None], n - 1.0
    return np.sqrt(np.stack([_axis(column, dof) for column in variances.T], axis=1) / n[:, None])


def _axis(
    variance: Float[np.ndarray, " positions"], dof: Float[np.ndarray, " positions"]
) -> Float[np.ndarray, " positions"]:
    """Moderated variances of a sample at each position."""
    logs = np.log(variance) - digamma(dof / 2) + np.log(dof / 2)
    by_chance, fourth = float(np.mean(polygamma(1, dof / 2))), float(np.mean(polygamma(3, dof / 2)))
    excess = float(np.var(logs, ddof=1)) - by_chance
    # The standard deviation of the variance of these logarithms, from their fourth cumulant.
    if excess <= _AGREE * np.sqrt(2 * by_chance**2 / (len(logs) - 1) + fourth / len(logs)):
        return np.full(len(variance), np.sum(dof * variance) / np.sum(dof))
    # 1 / trigamma is nearly linear (Smyth 2004, appendix).
    half = newton(lambda x: 1 / float(polygamma(1, x)) - 1 / excess, 0.5 + 1 / excess)
    prior_dof = 2 * half
    common = np.exp(np.mean(logs) + digamma(prior_dof / 2) - np.log(prior_dof / 2))
    return (prior_dof * common + dof * variance) / (prior_dof + dof)
