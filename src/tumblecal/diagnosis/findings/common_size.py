"""Coefficients of one effect have one order of magnitude: what the data hardly determine is taken from what they determine.

A named effect may have coefficients that the data determine to a part of their size and others that they hardly determine; by
least squares the latter take any value, and carry the parameters that they are correlated with far away. All coefficients
of an effect, in their typical sizes, are taken as draws of one normal distribution about zero, of whose width nothing is
known (its logarithm is flat), as `exact.hidden` does for directions that show not at all. The width is integrated over by
its marginal likelihood; where few coefficients determine it, it is widened as Student's t is (Gelman et al., Bayesian Data
Analysis, section 5.4). Coefficients that are determined well hardly move.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.exact.hidden import fitted_and_hidden, widening
from tumblecal.diagnosis.exact.insert import directions_of
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.estimation.fit import Fit


# Widths in typical sizes over which the marginal likelihood is summed: far below and far above all effects that are met.
_WIDTHS = np.geomspace(0.05, 500.0, 60)
# At this level the interval is that of Student's t. At 0.95 the intervals of coefficients that are determined to a part of
# their size held 91 to 93 %, at this level 94.5 % (test_common_size.py).
_LEVEL = 0.99


def prior_rows(
    causes: Sequence[Cause],
    directions: Float[np.ndarray, "full free"],
    sizes: Float[np.ndarray, " full"],
    covariance: Float[np.ndarray, "full full"],
) -> Float[np.ndarray, "prior full"]:
    """Rows `R` of the prior `R v ~ N(0, 1)` of the scaled full vector `v`: one for each fitted direction of the coefficients of
    an effect that has several.

    **Arguments:**

    - `directions`: of the scaled full vector, those that are fitted. `sizes`, `covariance`: its estimate, by the noise alone.
    """
    rows = [np.zeros((0, len(sizes)))]
    for cause in causes:
        own = list(cause.slot.columns)
        shown, _ = fitted_and_hidden(cause, directions)
        if shown.shape[1] > 1:
            block = np.zeros((shown.shape[1], len(sizes)))
            spread = shown.T @ covariance[np.ix_(own, own)] @ shown
            block[:, own] = shown.T / _common_sd(shown.T @ sizes[own], spread)
            rows.append(block)
    return np.vstack(rows)


def _common_sd(sizes: Float[np.ndarray, " shown"], covariance: Float[np.ndarray, "shown shown"]) -> float:
    """The sd of the distribution that the coefficients are drawn from, widened for what is not known of it."""
    variances, axes = np.linalg.eigh(covariance)
    turned, variances = (axes.T @ sizes) ** 2, np.maximum(variances, 0.0)
    whole = variances + _WIDTHS[:, None] ** 2
    log_weights = -0.5 * np.sum(np.log(whole) + turned / whole, axis=1)
    weights = np.exp(log_weights - np.max(log_weights))
    precision = float(weights @ _WIDTHS**-2.0 / np.sum(weights))
    determined = max(1.0, float(np.sum(1.0 / (1.0 + precision * variances))))
    return widening(determined, _LEVEL) / float(np.sqrt(precision))


def with_common_size(fit: Fit, at: Tangent, causes: Sequence[Cause], sigma: float) -> Fit:
    """A fit with the prior of a common size: values and covariance updated, rows and Jacobian with those of the prior.

    **Arguments:**

    - `fit`: exact, of the nominal parameters and `causes`. `sigma`: noise in units of its white rows.
    """
    scales, directions = at.model.scales, directions_of(at, causes)
    columns = [*range(at.model.nominal), *(column for cause in causes for column in cause.slot.all_columns)]
    if not fit.code.good or len(columns) != len(fit.names):
        return fit
    sizes, covariance = np.zeros(len(scales)), np.zeros((len(scales), len(scales)))
    sizes[columns] = fit.values / scales[columns]
    covariance[np.ix_(columns, columns)] = fit.noise_covariance / np.outer(scales[columns], scales[columns])
    rows = prior_rows(causes, directions, sizes, covariance)
    if not len(rows):
        return fit
    named = rows[:, columns] / scales[columns]
    values, updated = updated_by(named, fit.values, fit.noise_covariance)
    jacobian = np.zeros((len(rows), fit.jacobian.shape[1]))
    jacobian[:, : directions.shape[1]] = sigma * (rows @ directions)
    return replace(
        fit,
        values=values,
        covariance=updated + fit.hidden @ fit.hidden.T if fit.hidden.size else updated,
        rows=np.append(fit.rows, -sigma * (named @ fit.values)),
        jacobian=np.vstack([fit.jacobian, jacobian]),
    )


def updated_by(
    rows: Float[np.ndarray, "prior names"],
    values: Float[np.ndarray, " names"],
    covariance: Float[np.ndarray, "names names"],
) -> tuple[Float[np.ndarray, " names"], Float[np.ndarray, "names names"]]:
    """Values and their covariance, updated by the prior `rows values ~ N(0, 1)` (Joseph's form)."""
    across = covariance @ rows.T
    gain = np.linalg.solve(rows @ across + np.eye(len(rows)), across.T).T
    kept = np.eye(len(values)) - gain @ rows
    return kept @ values, kept @ covariance @ kept.T + gain @ gain.T
