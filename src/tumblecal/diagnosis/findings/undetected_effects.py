"""The contribution of effects that were not detected to the uncertainty: their common size estimated from the same data.

Every effect that the explanation lacks may be there, at a size too small to be named. With `S` the white signals of their
coefficients at typical size, `L = (I - Q Q') S` the part that the fitted parameters cannot make and `r` the white residual, the
model is `r = L c + noise`, `c_j ~ N(0, t_j^2)` (a Gaussian linear model with random effects). The sd of a coefficient is
bounded twice: `1 / t^2 = 1 + n^2 / s^2`, by the catalogue's typical size (1) and by the size `s`, in noise sd, of its visible
signal (`n` at typical size), since an effect that is much larger is found and named. A direction that the nominal model absorbs
has no visible signal; its sd is the median of the others'.

The scale `s` is common to all effects. Its prior has a share at zero, so that adequate instruments keep narrow intervals. Every
sensor follows the temperature to first order, so these coefficients have at least 0.3 of their typical size. The scale is
integrated over by its marginal likelihood, not fixed at an estimate (Carlin and Louis, Bayes and Empirical Bayes Methods for
Data Analysis, 2000, section 3.5). Given `s` the coefficients have the mean and covariance of a Gaussian linear model
(Rasmussen and Williams, Gaussian Processes for Machine Learning, 2.7), and they shift the parameters by `J+ S c`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg.lapack import dtrtri  # type: ignore[attr-defined]

from tumblecal.diagnosis.exact.insert import directions_of
from tumblecal.diagnosis.findings.effect_signals import signals_at_typical_size
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.effects import Catalogue
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.identifiability import RANK_TOLERANCE
from tumblecal.ground.showing import brief


# Scales `s` (noise sd) and their prior weights; the first is that of no undetected effect. (benchmarks/undetected_coverage.py,
# seeds below 100, and 300)
SCALES = (0.0, 0.6, 1.0, 2.0, 5.0, 20.0)
WEIGHTS = (5.0, 2.0, 4.0, 3.0, 2.0, 1.0)
# Effects that every sensor has, and the least sd of their coefficients in typical sizes. (as above)
_OF_EVERY_SENSOR, _LEAST = ("bias_temperature.", "scale_temperature."), 0.3
# Its value is stated with the data (--gravity), or its uncertainty is an input of the budget.
_STATED = ("gravity_value",)


class UndetectedEffects(NamedTuple):
    """What undetected effects may add to some quantities, and what the data say of their size.

    - `covariance`: mean square of the shifts about the fitted values.
    - `shifts`: by one unit of each direction of the effects' coefficients; `sizes`: their mean squares, given the data;
      `numbers`: whose each is among `ids`.
    - `probabilities`: of each of `SCALES`, given the data.
    """

    __repr__ = brief

    covariance: Float[np.ndarray, "quantities quantities"]
    shifts: Float[np.ndarray, "quantities directions"]
    sizes: Float[np.ndarray, " directions"]
    numbers: Int[np.ndarray, " directions"]
    ids: tuple[str, ...]
    probabilities: Float[np.ndarray, " scales"]

    def strongest(self, quantity: int, most: int) -> list[str]:
        """The effects that add most to the uncertainty of one quantity."""
        parts = np.bincount(self.numbers, self.shifts[quantity] ** 2 * self.sizes, len(self.ids))
        return [self.ids[number] for number in np.argsort(-parts)[:most].tolist() if parts[number] > 0]


def undetected_effects(
    screened: Screened, entries: Catalogue, extended: Fit, sigma: float, to: Float[np.ndarray, "quantities full"]
) -> UndetectedEffects:
    """The shifts of some quantities by all effects that are not in the explanation.

    **Arguments:**

    - `extended`: exact fit of the explanation. `sigma`: noise in units of the white rows.
    - `to`: derivative of the quantities by the scaled full vector.
    """
    at, fitted = screened.at, extended.jacobian / sigma
    named = {*_STATED, *(cause.slot.id for cause in screened.members)}
    listed = signals_at_typical_size(screened, entries, named, absorbed=True)
    signals, shown = listed.rows.T / sigma, listed.shown
    # The rows of a prior follow those of the readings.
    signals = np.vstack([signals, np.zeros((len(fitted) - len(signals), signals.shape[1]))])
    # Positions that did not take part say nothing.
    signals[~fitted.any(axis=1)] = 0.0
    free = directions_of(at, screened.members)
    moved = (to @ free) @ (np.linalg.pinv(fitted, rcond=RANK_TOLERANCE)[: free.shape[1]] @ signals)
    visible = np.linalg.norm(at.basis.T @ signals[: len(at.basis)], axis=0)
    projected = extended.reached.T @ signals
    inner = signals.T @ signals - projected.T @ projected
    towards = (extended.rows @ signals - (extended.rows @ extended.reached) @ projected) / sigma
    whole = max(float(extended.rows @ extended.rows) / sigma**2, 1e-300)
    always = np.array([id.startswith(_OF_EVERY_SENSOR) for id in listed.ids], bool)[listed.numbers] & shown
    log_weights, covariances, squares = np.log(WEIGHTS), [], []
    for number, scale in enumerate(SCALES):
        sd = scale / np.hypot(scale, visible) if scale else np.zeros(len(visible))
        sd[~shown] = np.median(sd[shown]) if np.any(shown) else 0.0
        sd[always] = np.maximum(sd[always], _LEAST)
        root = np.linalg.cholesky(np.eye(len(sd)) + inner * np.outer(sd, sd))
        inverse = (dtrtri(root, lower=1)[0] if len(sd) else root) * sd
        explained = inverse @ towards
        mean, spread = inverse.T @ explained, moved @ inverse.T
        shift = moved @ mean
        covariances.append(spread @ spread.T + np.outer(shift, shift))
        squares.append(np.einsum("ij,ij->j", inverse, inverse) + mean**2)
        gained = float(explained @ explained)
        if not screened.problem.known:
            gained = -extended.dof * float(np.log(max(1.0 - gained / whole, 1e-12)))
        log_weights[number] += 0.5 * gained - float(np.sum(np.log(np.diag(root))))
    probabilities = np.exp(log_weights - np.max(log_weights))
    probabilities /= np.sum(probabilities)
    covariance = np.tensordot(probabilities, np.array(covariances), 1)
    return UndetectedEffects(
        covariance, moved, probabilities @ np.array(squares), listed.numbers, listed.ids, probabilities
    )
