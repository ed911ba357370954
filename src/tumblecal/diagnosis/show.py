"""What the residuals look like: harmonics by axis and pitch setting, and a posterior-predictive comparison."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.diagnosis.adapt import Fit
from tumblecal.diagnosis.linear import Weighting
from tumblecal.diagnosis.noise import measuring_order
from tumblecal.effects import AXES


HARMONICS = 5
SIMULATIONS = 2000
_TAIL = 0.0007
# Probabilities at which a check's simulated distribution is kept.
QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)


@dataclass(frozen=True)
class Harmonic:
    """Amplitudes (g) of one residual harmonic at one pitch setting: cosine and sine (mean: cosine)."""

    axis: str
    pitch: int
    order: int
    cosine: float
    sine: float
    sd: float


@dataclass(frozen=True)
class Check:
    """One statistic of the residuals beside what the fitted model with its noise gives.

    `low`, `high`: the range of simulated data (one percent outside, all statistics together); `outside`: beyond it.
    `quantiles`: of the simulated values, at the probabilities `QUANTILES`.
    """

    name: str
    value: float
    low: float
    high: float
    quantiles: tuple[float, ...] = ()

    @property
    def outside(self) -> bool:
        """Whether the measured value is not one that the model makes."""
        return not self.low <= self.value <= self.high


def harmonics(
    where: Where, residuals: Float[np.ndarray, "positions 3"], sigma: Float[np.ndarray, "positions 3"]
) -> list[Harmonic]:
    """Least-squares harmonics 0 to 4 of the residuals over alpha, for every axis and pitch setting."""
    found = []
    pitch = np.asarray(where.index("pitch"))
    orders = np.arange(HARMONICS)
    for setting in np.unique(pitch):
        here = pitch == setting
        angles = np.outer(np.asarray(where.alpha)[here], orders)
        waves = np.stack([np.cos(angles), np.sin(angles)])
        norms = np.sum(waves**2, axis=1)
        sums = np.einsum("cpo,pa->aoc", waves, residuals[here])
        sizes = np.divide(sums, norms.T, out=np.zeros_like(sums), where=norms.T > 1e-9)
        sd = np.mean(sigma[here], axis=0)[:, None] / np.sqrt(np.max(norms, axis=0))
        found += [
            Harmonic(name, int(setting), order, float(cosine), float(sine), float(sd[axis, order]))
            for order in orders.tolist()
            for axis, name in enumerate(AXES)
            for cosine, sine in [sizes[axis, order]]
        ]
    return found


def predictive(fit: Fit, where: Where, how: Weighting, seed: int = 0) -> list[Check]:
    """Statistics of the residuals beside those of data simulated from the fitted model.

    The simulated data are refitted (linearly): their residuals are projected noise, as the measured ones are. With
    unknown noise every draw is scaled to the measured sum of squares, so that only the pattern is judged.
    """
    draws, measured = simulated_residuals(fit, how, seed), fit.residual[:, None]
    count = how.weights.size
    shape = (len(fit.keep), 3)
    order = np.argsort(measuring_order(where), kind="stable")
    order = order[fit.keep[order]]
    simulated = _statistics(draws[:count].reshape(*shape, -1)[order])
    values = _statistics(measured[:count].reshape(*shape, -1)[order])
    if how.known:
        simulated["sum of squares"], values["sum of squares"] = np.sum(draws**2, axis=0), np.sum(measured**2, axis=0)
    # The limits share the one percent between the statistics.
    limits = _quantiles(np.stack(list(simulated.values())), (_TAIL, 1 - _TAIL, *QUANTILES)).tolist()
    return [
        Check(name, float(values[name][0]), low, high, tuple(between))
        for name, (low, high, *between) in zip(simulated, limits, strict=True)
    ]


def _quantiles(
    draws: Float[np.ndarray, "statistics draws"], probabilities: tuple[float, ...]
) -> Float[np.ndarray, "statistics probabilities"]:
    """As `np.quantile`; one sort is quicker than many partitions."""
    ordered, place = np.sort(draws, axis=1), np.array(probabilities) * (draws.shape[1] - 1)
    low = np.minimum(place.astype(int), draws.shape[1] - 2)
    return ordered[:, low] + (ordered[:, low + 1] - ordered[:, low]) * (place - low)


def simulated_residuals(fit: Fit, how: Weighting, seed: int = 0) -> Float[np.ndarray, "rows draws"]:
    """Weighted residuals of data simulated from the fitted model and refitted; zero for positions left out."""
    q, _ = np.linalg.qr(fit.jacobian)
    draws = _normal(seed, len(fit.residual))
    if not np.all(fit.keep):
        draws = draws.copy()
        draws[: how.weights.size][~np.repeat(fit.keep, 3)] = 0.0
    draws = draws - q @ (q.T @ draws)
    if not how.known:
        draws *= np.linalg.norm(fit.residual) / np.linalg.norm(draws, axis=0)
    return draws


@lru_cache(maxsize=2)
def _normal(seed: int, rows: int) -> Float[np.ndarray, "rows draws"]:
    draws = np.random.default_rng(seed).standard_normal((rows, SIMULATIONS))
    draws.flags.writeable = False
    return draws


def _statistics(rows: Float[np.ndarray, "positions 3 draws"]) -> dict[str, np.ndarray]:
    """Size, largest value, neighbours' correlation and shares of the axes, for each draw."""
    power = rows**2
    by_axis, by_position = np.sum(power, axis=0), np.sum(power, axis=1)
    squares = np.sum(by_axis, axis=0)
    mean = squares / (power.shape[0] * 3)
    found = {
        "largest over rms": np.sqrt(np.max(power, axis=(0, 1)) / mean),
        "kurtosis": np.einsum("pad,pad->d", power, power) / (power.shape[0] * 3) / mean**2,
        "correlation of neighbours": np.einsum("pad,pad->d", rows[1:], rows[:-1]) / squares,
        "largest position": np.max(by_position, axis=0) / squares,
    }
    for place, axis in enumerate(AXES):
        found[f"share of axis {axis}"] = by_axis[place] / squares
    return found
