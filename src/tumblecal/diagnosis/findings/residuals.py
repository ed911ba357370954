"""Structure of the residuals: harmonics by axis and pitch setting, and a posterior predictive check."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from jaxtyping import Bool, Float
from pydantic import computed_field
from scipy.special import ndtri

from tumblecal.effects import AXES
from tumblecal.estimation.fit import Fit
from tumblecal.full_model.priors import VISIBLE
from tumblecal.ground.angle_settings import setting_index


HARMONICS = 5
SIMULATIONS = 2000
# So many simulated residuals at once.
_AT_ONCE = 250_000
_TAIL = 0.0007
# Probabilities at which a check's simulated distribution is kept.
QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)
# Harmonics are reported for pitch settings with at least this many spindle angles.
LEAST_ANGLES = 4
_OUTSIDE = 0.005


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
    """One statistic of the residuals, compared with data simulated from the fitted model and its noise.

    `low`, `high`: the range of simulated data (one percent outside, all statistics together); `outside`: beyond it.
    `quantiles`: of the simulated values, at the probabilities `QUANTILES`.
    """

    name: str
    value: float
    low: float
    high: float
    quantiles: tuple[float, ...] = ()

    @computed_field
    @property
    def outside(self) -> bool:
        """Whether the measured value is not one that the model makes."""
        return not self.low <= self.value <= self.high


def harmonics(fit: Fit, level: float) -> list[Harmonic]:
    """Least-squares harmonics 0 to 4 of the residuals over alpha, for every axis and pitch setting with positions in the fit.

    **Arguments:**

    - `level`: sd of the white rows.
    """
    where, sigma, listed = fit.problem.where, level * fit.problem.sd, list[Harmonic]()
    pitch, angles = np.asarray(where.index("pitch")), np.asarray(where.alpha)[:, None] * np.arange(HARMONICS)
    for setting in np.unique(pitch[fit.retained]).tolist():
        here = (pitch == setting) & fit.retained
        waves = np.stack([np.cos(angles[here]), np.sin(angles[here])])
        norms = np.sum(waves**2, axis=1)
        sums = fit.residuals[here].T @ waves
        (cosines, sines) = np.divide(sums, norms[:, None], out=np.zeros_like(sums), where=norms[:, None] > 1e-9)
        sd = np.mean(sigma[here], axis=0)[:, None] / np.sqrt(norms.max(axis=0))
        listed += [
            Harmonic(
                AXES[axis],
                setting,
                order,
                float(cosines[axis, order]),
                float(sines[axis, order]),
                float(sd[axis, order]),
            )
            for order in range(HARMONICS)
            for axis in range(3)
        ]
    return listed


def predictive(fit: Fit) -> list[Check]:
    """Statistics of the residuals, compared with those of data simulated from the fitted model.

    The simulated data are refitted (linearly): their residuals are projected noise, as the measured ones are. With
    unknown noise only their pattern is judged, which does not depend on how large they are.
    """
    pieces, values = [_statistics(fit, draws) for draws in _projected(fit)], _statistics(fit, fit.rows[:, None])
    # The limits share the one percent between the statistics.
    simulated = np.stack([np.concatenate([piece[name] for piece in pieces]) for name in values])
    limits = np.quantile(simulated, (_TAIL, 1 - _TAIL, *QUANTILES), axis=1).T.tolist()
    return [
        Check(name, float(own[0]), low, high, tuple(between))
        for (name, own), (low, high, *between) in zip(values.items(), limits, strict=True)
    ]


def _projected(fit: Fit) -> Iterator[Float[np.ndarray, "rows draws"]]:
    """What a refit leaves of normal noise of variance one."""
    q = fit.column_space
    normal = _normal(len(fit.rows))
    for drawn in np.array_split(normal, 1 + normal.size // _AT_ONCE, axis=1):
        draws = drawn
        if not np.all(fit.retained):
            draws = draws.copy()
            draws[: fit.residuals.size][~np.repeat(fit.retained, 3)] = 0.0
        taken_up = q @ (q.T @ draws)
        yield np.subtract(draws, taken_up, out=taken_up)


@lru_cache(maxsize=2)
def _normal(rows: int) -> Float[np.ndarray, "rows draws"]:
    draws = np.random.default_rng(0).standard_normal((rows, SIMULATIONS))
    draws.flags.writeable = False
    return draws


def _statistics(fit: Fit, draws: Float[np.ndarray, "rows draws"]) -> dict[str, np.ndarray]:
    """Size, largest value, neighbours' correlation and shares of the axes, for each draw of a fit's white residuals; where
    the noise is known, their sum of squares."""
    order = np.argsort(fit.problem.where.measuring_order, kind="stable")
    rows = draws[: fit.residuals.size].reshape(len(fit.retained), 3, -1)[order[fit.retained[order]]]
    power = rows**2
    by_axis, by_position = np.sum(power, axis=0), np.sum(power, axis=1)
    squares, count = np.sum(by_axis, axis=0), power.shape[0] * 3
    statistics = {
        "largest over rms": np.sqrt(np.max(power, axis=(0, 1)) * count / squares),
        "kurtosis": np.einsum("pad,pad->d", power, power) * count / squares**2,
        "correlation of neighbours": np.einsum("pad,pad->d", rows[1:], rows[:-1]) / squares,
        "largest position": np.max(by_position, axis=0) / squares,
    }
    statistics |= {f"share of axis {axis}": own / squares for axis, own in zip(AXES, by_axis, strict=True)}
    if fit.problem.known:
        statistics["sum of squares"] = squares + np.sum(draws[fit.residuals.size :] ** 2, axis=0)
    return statistics


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
    """Sorted weighted residuals, in units of the noise, with those of simulated data: 99 % of them lie within `low` and `high`
    at each place."""

    normal: Float[np.ndarray, " readings"]
    measured: Float[np.ndarray, " readings"]
    middle: Float[np.ndarray, " readings"]
    low: Float[np.ndarray, " readings"]
    high: Float[np.ndarray, " readings"]

    @computed_field
    @property
    def outside(self) -> Bool[np.ndarray, " readings"]:
        """The residuals beyond the simulated range."""
        return (self.measured < self.low) | (self.measured > self.high)


def discrepancies(fit: Fit, level: float) -> list[Discrepancy]:
    """Harmonics 0 to 4 of the residuals, each divided by the standard deviation that remains after the fit.

    Only where a pitch setting has at least four spindle angles, and orders up to half their number.

    **Arguments:**

    - `level`: standard deviation of the white residuals: 1 for known noise, otherwise that of the best explanation.
    """
    where, listed, waves = fit.problem.where, list[tuple[int, int, str]](), list[np.ndarray]()
    pitch, alpha = np.asarray(where.index("pitch")), np.asarray(where.alpha)
    for setting in np.unique(pitch[fit.retained]).tolist():
        here = (pitch == setting) & fit.retained
        angles = int(setting_index(alpha[here], held=False).max()) + 1
        orders = range(min(HARMONICS, angles // 2 + 1)) if angles >= LEAST_ANGLES else ()
        for order, (wave, function) in product(orders, {"cos": np.cos, "sin": np.sin}.items()):
            values = here * function(order * alpha)
            if np.sum(values**2) >= 1e-9 * np.sum(here):
                listed.append((setting, order, wave))
                waves.append(values)
    if not listed:
        return []
    # The combinations of white rows that are the sums of each axis's residuals (g) times each wave.
    flat = (np.array(waves).T[:, None, None] * np.eye(3)[:, :, None]).reshape(fit.residuals.size, -1)
    flat = np.linalg.solve(fit.problem.whitening_matrix.T, flat)
    rows = np.pad(flat, ((0, len(fit.rows) - len(flat)), (0, 0)))
    sizes = np.linalg.norm(rows - fit.column_space @ (fit.column_space.T @ rows), axis=0)
    seen = (sizes / np.linalg.norm(rows, axis=0)).tolist()
    in_sd = (fit.rows @ rows / np.maximum(sizes * level, 1e-300)).tolist()
    every = zip(product(AXES, listed), seen, in_sd, strict=True)
    each = [Discrepancy(axis, *own, share, size if share > VISIBLE else None) for (axis, own), share, size in every]
    return [each[axis * len(listed) + k] for k in range(len(listed)) for axis in range(3)]


def normal_quantiles(fit: Fit) -> NormalQuantiles:
    """The residuals against normal quantiles, with the range of data simulated from the fitted model."""
    taken = np.flatnonzero(np.repeat(fit.retained, 3))
    level = 1.0 if fit.problem.known else fit.level
    draws = np.hstack(list(_projected(fit)))
    if not fit.problem.known:
        # Every draw is scaled to the measured sum of squares.
        draws *= np.linalg.norm(fit.rows) / np.linalg.norm(draws, axis=0)
    simulated = np.sort(draws[taken] / level, axis=0)
    low, middle, high = np.quantile(simulated, [_OUTSIDE, 0.5, 1 - _OUTSIDE], axis=1)
    ranks = (np.arange(len(taken)) + 0.5) / len(taken)
    return NormalQuantiles(ndtri(ranks), np.sort(fit.rows[taken]) / level, middle, low, high)
