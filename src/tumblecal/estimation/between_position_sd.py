"""How badly positions repeat beyond the sd of their means: a floor that is added to every sd in quadrature.

The sd of a mean says how well the samples of one dwell agree. A head that does not come back, or a hand, scatters from
position to position by more, and no sample shows it. The floor is the variance that restricted maximum likelihood
(Patterson and Thompson 1971) finds beside the stated one, on the residuals of the exact fit and its Jacobian.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import special

from tumblecal.estimation.fit import Fit
from tumblecal.estimation.problem import Problem
from tumblecal.noise.covariance import Covariance


# A floor is taken from this p-value of the likelihood ratio on, and with this many degrees of freedom.
_SIGNIFICANT, _LEAST_DOF = 0.01, 5
# It is looked for from this multiple of the stated sd to this one of the largest residual, however far that is.
_LEAST, _MOST = 1e-2, 10.0
# Repeats that scatter by less than this share of the whole show that the rest comes back with the attitude.
_COMES_BACK = 0.5


@dataclass(frozen=True)
class BetweenPositionSd:
    """What the positions scatter beside the sd of their means.

    - `floor_g`: the sd that is added in quadrature to that of every reading, g; `stated_g`: the median stated one, g.
    - `p_value`: of the likelihood ratio against no floor.
    - `repeats_g`: the floor by which readings of one attitude differ (pure error), g; None without enough repeats.
    """

    floor_g: float
    stated_g: float
    p_value: float
    repeats_g: float | None = None

    @property
    def words(self) -> str:
        """The scatter, its size, and its possible causes."""
        total = float(np.hypot(self.floor_g, self.stated_g)) * 1e3
        found = (
            f"The positions scatter about the model by {total:.2g} mg; by the sd columns alone it would be "
            f"{self.stated_g * 1e3:.2g} mg. A floor of {self.floor_g * 1e3:.2g} mg is added to every sd in quadrature"
        )
        if self.repeats_g is None:
            return f"{found}: a head or a hand that does not repeat, or an error of the model (a diagnosis separates them)."
        repeated = float(np.hypot(self.repeats_g, self.stated_g)) * 1e3
        if repeated < _COMES_BACK * total:
            return f"{found}. Repeats of an attitude agree to {repeated:.2g} mg: the rest comes back, so the model is wrong."
        return f"{found}. Repeats of an attitude scatter by {repeated:.2g} mg as well: it is how they repeat."

    def applied(self, problem: Problem) -> Problem:
        """The problem with the floor in every reading's variance; its level counts as estimated from then on."""
        variance = self.floor_g**2
        sd = np.sqrt(problem.sd**2 + variance)
        noise = Covariance.of_sd(sd)
        if problem.correlated:
            noise = Covariance(problem.noise.matrix + variance * np.eye(problem.readings.size), "full")
        return problem.with_noise(noise, known=False, sd=sd)


def between_position_sd(fit: Fit) -> BetweenPositionSd | None:
    """The floor of an exact fit whose noise is stated; None where the stated sd explains the scatter, or too few degrees of
    freedom are left to tell."""
    problem = fit.problem
    if not problem.known or fit.dof < _LEAST_DOF or fit.chi2 <= fit.dof:
        return None
    stated, count = float(np.median(problem.sd)), problem.readings.size
    # What a floor of one g^2 adds to the covariance of the white rows: a diagonal, in the eigenvectors' coordinates.
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
    """White rows of a mean of its own for every attitude and axis that take part; no columns where attitudes are unknown."""
    kept = problem.takes_part
    attitude = problem.where.attitude
    if problem.data is not None and problem.data.hand_held:
        attitude = np.arange(len(kept))
    own = (attitude[:, None] == np.unique(attitude[kept])) & kept[:, None]
    return problem.rows(np.einsum("pm,ij->pimj", own.astype(float), np.eye(3)).reshape(len(kept), 3, -1))


def _estimated(
    rows: Float[np.ndarray, " rows"],
    design: Float[np.ndarray, "rows columns"],
    added: Float[np.ndarray, " rows"],
    stated: float,
) -> tuple[float, float]:
    """The floor (g) of the highest restricted likelihood, and the p-value of its ratio to that of none.

    **Arguments:**

    - `added`: what a floor of one g^2 adds to each row's variance.
    """
    # Loaded in a tenth of a second, which calibrations without sd columns do without.
    from scipy.optimize import minimize_scalar

    # Positions left out have rows of zeros, which say nothing.
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
