"""What the residuals hold that no nominal parameter can reach: their harmonics, and their whole distribution."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

from tumblecal.chain import Where
from tumblecal.diagnosis.adapt import Fit
from tumblecal.diagnosis.candidates import VISIBLE
from tumblecal.diagnosis.linear import Weighting
from tumblecal.diagnosis.show import HARMONICS, simulated_residuals
from tumblecal.effects import AXES


# Harmonics are told for pitch settings of at least this many spindle angles.
LEAST_ANGLES = 4
_OUTSIDE = 0.005


@dataclass(frozen=True)
class Discrepancy:
    """The residual's part along one harmonic of alpha, on one axis at one pitch setting.

    `wave`: cos or sin (order 0: cos); `seen`: the share of the harmonic that the fitted parameters leave; `in_sd`: the
    residual's part in units of the sd that it has when the model is right, None where nothing of it can be seen.
    """

    axis: str
    pitch: int
    order: int
    wave: str
    seen: float
    in_sd: float | None


@dataclass(frozen=True)
class NormalQuantiles:
    """Sorted weighted residuals, in units of the noise, beside those of simulated data: 99 % of them lie within
    `low` and `high` at each place."""

    normal: Float[np.ndarray, " readings"]
    measured: Float[np.ndarray, " readings"]
    middle: Float[np.ndarray, " readings"]
    low: Float[np.ndarray, " readings"]
    high: Float[np.ndarray, " readings"]

    @property
    def outside(self) -> Bool[np.ndarray, " readings"]:
        """The residuals beyond the simulated range."""
        return (self.measured < self.low) | (self.measured > self.high)


def discrepancies(fit: Fit, where: Where, how: Weighting, noise: float) -> list[Discrepancy]:
    """Harmonics 0 to 4 of the residuals, each divided by what the fit leaves of its sd.

    Only where a pitch setting has at least four spindle angles, and orders up to half their number.

    **Arguments:**

    - `fit`, `where`, `how`: the fit, its settings and weights.
    - `noise`: sd of the weighted residuals: 1 where the noise is known, else that of the best explanation.
    """
    q, _ = np.linalg.qr(fit.jacobian)
    pitch, alpha = np.asarray(where.index("pitch")), np.asarray(where.alpha)
    found = []
    for setting in np.unique(pitch):
        here = np.flatnonzero((pitch == setting) & fit.keep)
        angles = len(np.unique(np.round(alpha[here], 6)))
        if angles < LEAST_ANGLES:
            continue
        for order in range(min(HARMONICS, angles // 2 + 1)):
            for wave, values in (("cos", np.cos(order * alpha[here])), ("sin", np.sin(order * alpha[here]))):
                if np.sum(values**2) < 1e-9 * len(here):
                    continue
                for place, axis in enumerate(AXES):
                    rows = _rows(values, here, place, how, len(fit.residual))
                    left = rows - q @ (q.T @ rows)
                    seen = float(np.linalg.norm(left) / np.linalg.norm(rows))
                    size = float(rows @ fit.residual / (np.linalg.norm(left) * noise)) if seen > VISIBLE else None
                    found.append(Discrepancy(axis, int(setting), order, wave, seen, size))
    return found


def _rows(values: np.ndarray, here: np.ndarray, axis: int, how: Weighting, count: int) -> np.ndarray:
    """The combination of weighted rows that is the sum of residuals (g) times `values`."""
    wave = np.zeros_like(how.weights)
    wave[here, axis] = values
    flat = (wave / how.weights).ravel()
    flat = flat if how.whiten is None else np.linalg.solve(how.whiten.T, flat)
    return np.concatenate([flat, np.zeros(count - len(flat))])


def normal_quantiles(fit: Fit, how: Weighting) -> NormalQuantiles:
    """The residuals against normal quantiles, with the range of data simulated from the fitted model."""
    taken = np.flatnonzero(np.repeat(fit.keep, 3))
    noise = 1.0 if how.known else fit.sigma
    simulated = np.sort(simulated_residuals(fit, how)[taken] / noise, axis=0)
    low, middle, high = np.quantile(simulated, [_OUTSIDE, 0.5, 1 - _OUTSIDE], axis=1)
    places = (np.arange(len(taken)) + 0.5) / len(taken)
    return NormalQuantiles(stats.norm.ppf(places), np.sort(fit.residual[taken]) / noise, middle, low, high)
