"""A noise model from an Allan deviation: quantisation, white, flicker, Gauss-Markov and random walk (IEEE 952, 1293).

Each part has a closed-form Allan variance, so the fit is linear in the squared coefficients and non-negative; only
the correlation time of the Gauss-Markov part is searched for.
"""

from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar, nnls

from tumblecal.capture.allan import AllanDeviation


# A part must lower chi-squared by this much for each of its parameters to be believed. Neighbouring points of an
# overlapping Allan deviation are correlated, so this is more than independent points would ask for.
_BELIEVED = 15.0


@dataclass(frozen=True)
class NoiseModel:
    """Coefficients of one axis, for data in g.

    **Arguments:**

    - `quantisation_g_s`: Q, Allan variance 3 Q^2 / tau^2.
    - `white_g_per_rthz`: N, N^2 / tau.
    - `flicker_g`: B (bias instability), B^2 2 ln 2 / pi.
    - `walk_g_per_rts`: K, K^2 tau / 3.
    - `markov_sd_g`, `markov_time_s`: standard deviation and correlation time.
    - `reduced_chi2`: how well the model fits.
    """

    quantisation_g_s: float = 0.0
    white_g_per_rthz: float = 0.0
    flicker_g: float = 0.0
    walk_g_per_rts: float = 0.0
    markov_sd_g: float = 0.0
    markov_time_s: float = 1.0
    reduced_chi2: float = float("nan")

    def as_dict(self) -> dict[str, float]:
        """For a file."""
        return asdict(self)

    def allan_variance(self, tau_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """The model's Allan variance, g^2."""
        parts = _basis(tau_s) @ np.square(
            [self.quantisation_g_s, self.white_g_per_rthz, self.flicker_g, self.walk_g_per_rts]
        )
        return parts + self.markov_sd_g**2 * markov_allan_variance(tau_s, self.markov_time_s)

    def mean_variance(self, duration_s: float) -> float:
        """Variance of a mean over `duration_s`, g^2.

        White and Gauss-Markov noise: about their own mean. Flicker and random walk have none that is finite: there it
        is the Allan variance at that time, the spread of neighbouring dwells.
        """
        t, tc = duration_s, self.markov_time_s
        markov = 2 * self.markov_sd_g**2 * tc / t * (1 - tc / t * (1 - np.exp(-t / tc)))
        allan = _basis(np.array([t]))[0] @ np.square(
            [self.quantisation_g_s, self.white_g_per_rthz, self.flicker_g, self.walk_g_per_rts]
        )
        return float(markov + allan)


def _basis(tau_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Allan variances of unit coefficients: quantisation, white, flicker, random walk; shape (m, 4)."""
    return np.stack([3 / tau_s**2, 1 / tau_s, np.full_like(tau_s, 2 * np.log(2) / np.pi), tau_s / 3], axis=1)


def markov_allan_variance(tau_s: NDArray[np.float64], time_s: float) -> NDArray[np.float64]:
    """Allan variance of a Gauss-Markov process of unit variance and this correlation time (IEEE 952, annex C)."""
    x = np.asarray(tau_s) / time_s
    # The difference below loses its digits for short times; its series starts with x^3 (2/3) - x^4 / 2.
    bracket = np.where(x < 1e-3, 2 * x**3 / 3 - x**4 / 2, 2 * x - 3 + 4 * np.exp(-x) - np.exp(-2 * x))
    return bracket / x**2


# What the slow part of a model may be.
SLOW = ("none", "flicker", "walk", "markov")


def fit_noise(allan: AllanDeviation) -> NoiseModel:
    """Fit the model to an Allan deviation, weighted by its degrees of freedom.

    **Arguments:**

    - `allan`: one axis, in g.
    """
    return min(fitted_models(allan).values(), key=lambda pair: pair[0])[1]


def fitted_models(allan: AllanDeviation) -> dict[str, tuple[float, NoiseModel]]:
    """For each slow part (`SLOW`) the best model whose slowest part it is, with its score: chi-squared and a price for
    every parameter. Half the difference of two scores is about the logarithm of their odds."""
    tau, variance = allan.tau_s, allan.deviation**2
    use = (variance > 0) & (allan.dof >= 1)
    if use.sum() < 4:
        white = float(np.sqrt(variance[0] * tau[0])) if len(variance) else 0.0
        return {"none": (0.0, NoiseModel(white_g_per_rthz=white))}
    tau, variance, dof = tau[use], variance[use], allan.dof[use]
    weight = _weights(tau, variance, dof)
    times = np.geomspace(3 * tau[0], tau[-1], 25)
    best: dict[str, tuple[float, NoiseModel]] = {}
    for parts in product((False, True), repeat=3):
        # White noise is always there; quantisation, flicker and walk are on trial, with and without a Markov part.
        chosen = np.array([parts[0], True, parts[1], parts[2]])
        for time_s in (None, _best_time(tau, variance, weight, chosen, times)):
            squared, chi2 = _fitted(tau, variance, weight, chosen, time_s)
            score = chi2 + _BELIEVED * (sum(parts) + 2 * (time_s is not None))
            left = max(len(tau) - np.count_nonzero(squared), 1)
            quantisation, white, flicker, walk, markov = np.sqrt(squared).tolist()
            model = NoiseModel(quantisation, white, flicker, walk, markov, time_s or 1.0, chi2 / left)
            kind = _slow_part(model, float(tau[-1]))
            if kind not in best or score < best[kind][0]:
                best[kind] = (score, model)
    return best


def _slow_part(model: NoiseModel, longest_s: float) -> str:
    """The slowest part of a model: a Markov part much shorter than the longest averaging time is not slow."""
    if model.walk_g_per_rts > 0:
        return "walk"
    if model.flicker_g > 0:
        return "flicker"
    return "markov" if model.markov_sd_g > 0 and model.markov_time_s > longest_s / 3 else "none"


def _best_time(
    tau: NDArray[np.float64],
    variance: NDArray[np.float64],
    weight: NDArray[np.float64],
    chosen: NDArray[np.bool_],
    times: NDArray[np.float64],
) -> float:
    """The correlation time that fits best: the best of a grid, refined."""

    def chi2(log_time: float) -> float:
        return _fitted(tau, variance, weight, chosen, float(np.exp(log_time)))[1]

    values = [chi2(t) for t in np.log(times)]
    k = int(np.argmin(values))
    low, high = np.log(times[max(k - 1, 0)]), np.log(times[min(k + 1, len(times) - 1)])
    found: Any = minimize_scalar(chi2, bounds=(low, high), method="bounded", options={"xatol": 0.01})
    return float(np.exp(found.x))


def _weights(tau: NDArray[np.float64], variance: NDArray[np.float64], dof: NDArray[np.float64]) -> NDArray[np.float64]:
    """One over the sd of each Allan variance, from a smooth curve through them: all parts at once.

    The sd is proportional to the true variance; taking the measured one would favour points that came out low.
    """
    times = np.geomspace(3 * tau[0], tau[-1], 6)
    columns = np.hstack([_basis(tau), *(markov_allan_variance(tau, t)[:, None] for t in times)])
    model = variance.copy()
    for _ in range(4):
        weight = np.sqrt(dof / 2) / model
        scale = np.linalg.norm(columns * weight[:, None], axis=0)
        solution = nnls(columns * weight[:, None] / scale, variance * weight)[0] / scale
        model = np.maximum(columns @ solution, 1e-3 * variance)
    return np.sqrt(dof / 2) / model


def _fitted(
    tau: NDArray[np.float64],
    variance: NDArray[np.float64],
    weight: NDArray[np.float64],
    chosen: NDArray[np.bool_],
    time_s: float | None,
) -> tuple[NDArray[np.float64], float]:
    """Squared coefficients (5: quantisation, white, flicker, walk, Markov) and chi-squared."""
    columns = [_basis(tau)[:, chosen]]
    if time_s is not None:
        columns.append(markov_allan_variance(tau, time_s)[:, None])
    design = np.hstack(columns) * weight[:, None]
    scale = np.linalg.norm(design, axis=0)
    solution, distance = nnls(design / scale, variance * weight)
    squared = np.zeros(5)
    squared[:4][chosen] = (solution / scale)[: chosen.sum()]
    if time_s is not None:
        squared[4] = solution[-1] / scale[-1]
    return squared, float(distance**2)
