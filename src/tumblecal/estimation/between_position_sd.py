"""Dispersion between positions beyond the standard uncertainty of their means: a floor, added to every sd in quadrature.

The sd of a mean describes the samples of one dwell. Imperfect repeatability of a head, or of a hand, adds dispersion between
positions that no dwell shows. The floor is the variance in addition to the stated one that restricted maximum likelihood
estimates (Patterson and Thompson 1971), from the residuals and the Jacobian of the exact fit.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import special

from tumblecal.estimation.fit import Fit
from tumblecal.estimation.problem import Problem
from tumblecal.noise.covariance import Covariance
from tumblecal.words import sentence


# A floor is used up to this p-value of the likelihood ratio, and with at least this many degrees of freedom.
_SIGNIFICANT, _LEAST_DOF = 0.01, 5
# Search range: from this multiple of the stated sd to this multiple of the largest residual.
_LEAST, _MOST = 1e-2, 10.0
# If repeats of an attitude differ by less than this share of the total, the remaining dispersion depends on the attitude.
_COMES_BACK = 0.5


@dataclass(frozen=True)
class BetweenPositionSd:
    """Dispersion between positions in addition to the sd of their means.

    - `floor_g`: sd added in quadrature to that of every reading, g; `stated_g`: median stated sd, g.
    - `p_value`: of the likelihood ratio against no floor.
    - `repeats_g`: the floor among readings of one attitude (pure error), g; None without enough repeats.
    """

    floor_g: float
    stated_g: float
    p_value: float
    repeats_g: float | None = None

    @property
    def words(self) -> str:
        """The scatter, its size, and its possible causes."""
        total = float(np.hypot(self.floor_g, self.stated_g)) * 1e3
        repeated = None if self.repeats_g is None else float(np.hypot(self.repeats_g, self.stated_g)) * 1e3
        come_back = repeated is not None and repeated < _COMES_BACK * total
        return sentence("noise/floor", n=self, total=total, repeated=repeated, come_back=come_back)

    def applied(self, problem: Problem) -> Problem:
        """The problem with the floor in every reading's variance; its noise level is then estimated."""
        variance = self.floor_g**2
        sd = np.sqrt(problem.sd**2 + variance)
        noise = Covariance.of_sd(sd)
        if problem.correlated:
            noise = Covariance(problem.noise.matrix + variance * np.eye(problem.readings.size), "full")
        return problem.with_noise(noise, known=False, sd=sd)


def between_position_sd(fit: Fit) -> BetweenPositionSd | None:
    """The floor for an exact fit with stated noise; None if the stated sd explains the dispersion, or if there are too few
    degrees of freedom."""
    problem = fit.problem
    if not problem.known or fit.dof < _LEAST_DOF or fit.chi2 <= fit.dof:
        return None
    stated, count = float(np.median(problem.sd)), problem.readings.size
    # Contribution of a floor of one g^2 to the covariance of the white rows: diagonal in the eigenvectors' coordinates.
    turned = np.eye(count)
    added = np.asarray(problem.whitening).ravel() ** 2
    if problem.correlated:
        root = problem.whitening_matrix
        added, turned = np.linalg.eigh(root @ root.T)
    added = np.concatenate([added, np.zeros(len(fit.rows) - count)])
    rows = np.concatenate([turned.T @ fit.rows[:count], fit.rows[count:]])
    design = np.vstack([turned.T @ fit.jacobian[:count], fit.jacobian[count:]])
    floor, p_value = _estimated(rows, design, added, stated)
    if p_value > _SIGNIFICANT:
        return None
    means = _attitude_means(problem)
    repeats = None
    if np.sum(problem.takes_part) * 3 - means.shape[1] >= _LEAST_DOF:
        repeats = _estimated(rows[:count], turned.T @ means, added[:count], stated)[0]
    return BetweenPositionSd(floor, stated, p_value, repeats)


def _attitude_means(problem: Problem) -> Float[np.ndarray, "rows means"]:
    """White rows of a separate mean for each attitude and axis in the fit; for unknown attitudes one for each position."""
    retained = problem.takes_part
    attitude = problem.where.attitude
    if problem.data is not None and problem.data.hand_held:
        attitude = np.arange(len(retained))
    of_attitude = (attitude[:, None] == np.unique(attitude[retained])) & retained[:, None]
    return problem.rows(np.einsum("pm,ij->pimj", of_attitude.astype(float), np.eye(3)).reshape(len(retained), 3, -1))


def _estimated(
    rows: Float[np.ndarray, " rows"],
    design: Float[np.ndarray, "rows columns"],
    added: Float[np.ndarray, " rows"],
    stated: float,
) -> tuple[float, float]:
    """The floor (g) of the highest restricted likelihood, and the p-value of its ratio to that of none.

    **Arguments:**

    - `added`: contribution of a floor of one g^2 to the variance of each row.
    """
    # The import takes a tenth of a second; calibrations without sd columns do not need it.
    from scipy.optimize import minimize_scalar

    # Excluded positions have rows of zeros.
    here = np.any(design != 0, axis=1)
    rows, design, added = rows[here], design[here], added[here]

    def cost(variance: float) -> float:
        sd = np.sqrt(1.0 + variance * added)
        q, r = np.linalg.qr(design / sd[:, None])
        rest = rows / sd
        rest = rest - q @ (q.T @ rest)
        log_det = float(np.sum(np.log(sd)) + np.sum(np.log(np.abs(np.diag(r)) + 1e-300)))
        return log_det + 0.5 * float(rest @ rest)

    measured = added > 0
    largest = float(np.max(np.abs(rows[measured]) / np.sqrt(added[measured]), initial=0.0))
    best: Any = minimize_scalar(
        lambda log_floor: cost(np.exp(2 * log_floor)),
        bounds=(np.log(_LEAST * stated), np.log(_MOST * max(largest, stated))),
        method="bounded",
        options={"xatol": 1e-4},
    )
    ratio = max(2.0 * (cost(0.0) - float(best.fun)), 0.0)
    # The floor cannot be negative: without one the ratio is zero in half of all sets (Self and Liang 1987).
    return float(np.exp(best.x)), 0.5 * float(special.chdtrc(1.0, ratio))
