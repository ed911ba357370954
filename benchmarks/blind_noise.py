"""One hidden effect in noise that is not as assumed: is the effect named, and is the noise?

Instruments and effects are those of the catalogue study. The assumption is white Gaussian noise, equal on all axes, its sd
stated or unknown; the truth is one axis five times as noisy, Student's t, noise correlated from position to position, or
an attitude that every position repeats only to some extent. The effect's size d is the norm of its part that the nominal
model cannot reach, in the metric of the true noise.
"""

import numpy as np
from scipy.linalg import block_diag

import blind_instrument as blind
import tumblecal
from tumblecal.data import PositionSet


tumblecal.enable_float64()


PLANS = {"3x8": (3, 8), "4x12": (4, 12)}
TAIL = 2.5
NOISES = ("unequal", "heavy", "coloured", "attitude")
LABELS = {noise: f"noise_{noise}" for noise in NOISES} | {"heavy": "noise_heavy_tail"}


def covariance(kind: str, setup: blind.Setup, rng: np.random.Generator) -> np.ndarray:
    """Of all readings (position by position), in sigma squared; for heavy tails in units of their information."""
    count = len(setup.alpha)
    if kind == "unequal":
        spread = np.ones((count, 3))
        spread[:, rng.integers(3)] = 25.0
        return np.diag(spread.ravel())
    if kind == "coloured":
        order = np.arange(count)
        return np.kron(0.8 ** np.abs(order[:, None] - order), np.eye(3))
    if kind == "attitude":
        f = blind.readings(setup, {name: 0 * value for name, value in setup.nominal.items()}, {})
        return block_diag(*(np.eye(3) + 100.0 * (np.eye(3) - np.outer(vertical, vertical)) for vertical in f))
    return np.eye(3 * count) * (TAIL + 3) / (TAIL + 1)


def case(rng: np.random.Generator, plan: str, kind: str, d: float):
    """Setup, readings and the hidden effect's name (None where d is 0)."""
    while True:
        setup = blind.random_setup(rng, *PLANS[plan])
        spread = covariance(kind, setup, rng)
        whiten = np.linalg.inv(np.linalg.cholesky(spread))
        clean, name = blind.readings(setup, setup.nominal, {}), None
        if d:
            name = list(blind.COEFFICIENTS)[rng.integers(len(blind.COEFFICIENTS))]
            drawn = blind.sized(setup, blind.unreachable(setup), name, d, rng)
            if drawn is None:
                continue
            effect = drawn[0]
            tail = 1 if name == "warm_up" else 0
            for _ in range(3):
                signal = blind.readings(setup, setup.nominal, {name: effect}) - clean
                seen = _left(whiten, setup, signal.ravel() / blind.SIGMA)
                effect = effect.copy()
                effect[: len(effect) - tail] *= d / seen
            # An effect that is lost in such noise unless it is enormous is no fair case.
            if np.linalg.norm(blind.unreachable(setup) @ signal.ravel()) > 10 * d * blind.SIGMA:
                continue
            clean = clean + signal
        if kind == "heavy":
            noise = rng.standard_t(TAIL, size=clean.shape)
        else:
            noise = (np.linalg.inv(whiten) @ rng.normal(size=clean.size)).reshape(clean.shape)
        return setup, clean + blind.SIGMA * noise, name


def _left(whiten: np.ndarray, setup: blind.Setup, signal: np.ndarray) -> float:
    """Norm of what the nominal model leaves of a signal in whitened units."""
    q, _ = np.linalg.qr(whiten @ blind.nominal_columns(setup))
    rest = whiten @ signal
    return float(np.linalg.norm(rest - q @ (q.T @ rest)))


def position_set(setup: blind.Setup, readings: np.ndarray, known: bool, columns: bool = True) -> PositionSet:
    """With the noise stated, and with the conditions of each position."""
    conditions = {name: getattr(setup, name) for name in ("time_s", "temperature_degc", "approach") if columns}
    return PositionSet(
        tuple(setup.names),
        np.degrees(setup.alpha),
        np.degrees(setup.beta),
        readings,
        sd=np.full(readings.shape, blind.SIGMA) if known else None,
        **conditions,
    )


def excused(kind: str) -> tuple[str, ...]:
    """What may be named beside the effect: noise, and with heavy tails the positions that lie far out."""
    return ("noise_", "outlier_position") if kind == "heavy" else ("noise_",)
