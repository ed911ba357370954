"""Standard deviations of means of few samples: each says little, but all positions of an axis together say what it is.

The sd of five samples is off by a third. Taken as it stands it doubles chi-square of a right model, weighs readings by
chance, and intervals hold the truth too seldom. Empirical Bayes (Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3, 3) takes each
variance together with those of the other positions, by as much as they agree: where they differ by no more than so few samples
make them, all have their mean; where positions really differ, each keeps its own.
"""

import numpy as np
from jaxtyping import Float
from scipy.special import digamma, polygamma


# Beyond, a sample's sd is known to a tenth, and is taken as it stands.
FEW = 50
# Sds that differ by what so few samples make them, and up to so many sd of that more, agree.
_AGREE = 2.0


def of_few(n: Float[np.ndarray, " positions"]) -> bool:
    """Whether sd columns are of few samples: two or more of each position, and half of the positions with `FEW` or less."""
    return len(n) > 1 and bool(np.min(n) >= 2 and np.median(n) <= FEW)


def moderated(
    sd: Float[np.ndarray, "positions 3"], n: Float[np.ndarray, " positions"]
) -> Float[np.ndarray, "positions 3"]:
    """The sd of means, g, each by the samples of all positions as far as they agree; `n`: samples of each, two or more."""
    variances, own = sd**2 * n[:, None], n - 1.0
    return np.sqrt(np.stack([_axis(column, own) for column in variances.T], axis=1) / n[:, None])


def _axis(
    variance: Float[np.ndarray, " positions"], dof: Float[np.ndarray, " positions"]
) -> Float[np.ndarray, " positions"]:
    """Variances of a sample at each position, with what the others say."""
    logs = np.log(variance) - digamma(dof / 2) + np.log(dof / 2)
    by_chance, fourth = float(np.mean(polygamma(1, dof / 2))), float(np.mean(polygamma(3, dof / 2)))
    left = float(np.var(logs, ddof=1)) - by_chance
    # The sd of the variance of so many logarithms, from their fourth cumulant.
    if left <= _AGREE * np.sqrt(2 * by_chance**2 / (len(logs) - 1) + fourth / len(logs)):
        return np.full(len(variance), np.sum(dof * variance) / np.sum(dof))
    more = 2 * _inverse_trigamma(left)
    common = np.exp(np.mean(logs) + digamma(more / 2) - np.log(more / 2))
    return (more * common + dof * variance) / (more + dof)


def _inverse_trigamma(value: float) -> float:
    """Where trigamma has a value, by Newton's steps in 1 / trigamma, which is nearly a line (Smyth 2004, appendix)."""
    at = 0.5 + 1 / value
    for _ in range(50):
        trigamma = float(polygamma(1, at))
        step = trigamma * (1 - trigamma / value) / float(polygamma(2, at))
        at += step
        if abs(step) < 1e-10 * at:
            break
    return at
