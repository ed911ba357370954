"""Alternatives about the noise, the mean being right: unequal axes, coloured in time, heavy tails, attitude."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular
from scipy.special import gammaln

from tumblecal.chain import Where
from tumblecal.diagnosis.linear import Linear, Weighting


# Share of the prior that the noise alternatives have together, beside the candidates' one.
NOISE_WEIGHT = 0.08
_RATIOS = (0.25, 0.5, 2.0, 3.0, 5.0, 9.0)
_LEVELS = (0.1, 0.2, 0.4, 0.7, 1.4, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0)
_CORRELATIONS = (0.3, 0.5, 0.7, 0.85, 0.95)
_TAILS = (2.0, 4.0)
# Scatter of the attitude from position to position, in noise standard deviations of a reading, for 1 g.
_ATTITUDES = (2.0, 5.0, 15.0, 50.0, 200.0)
_LABELS = 4


@dataclass(frozen=True)
class Family:
    """Noise models that differ by a number.

    `covariance` of the weighted rows at a level; the `levels` tried; `words` for a level and the sd of the weighted rows.
    """

    covariance: Callable[[float], np.ndarray]
    levels: tuple[float, ...]
    words: Callable[[float, float], str]


@dataclass(frozen=True)
class NoiseAlternative:
    """Another distribution of the noise.

    - `label`: catalogue id; `words`: which one; `log_weight`: prior.
    - `whiten` (nu, nu): makes the residual white under it; `half_log_det` of its covariance.
    - `covariance`: of the weighted rows (positions * 3), a diagonal or a matrix.
    - `family`: where it is one of a continuous family, the covariance by `level`, which may be refined.
    - `tail`: degrees of freedom of Student's t where single readings have heavy tails; `whiten` is then the basis
      that gives the readings' residuals.
    """

    label: str
    words: str
    log_weight: float
    whiten: Float[np.ndarray, "rows nu"]
    half_log_det: float
    covariance: np.ndarray
    tail: float | None = None
    family: Family | None = None
    level: float = 1.0


def alternatives(linear: Linear, how: Weighting, where: Where) -> list[NoiseAlternative]:
    """The noise models that are tried against equal, white, Gaussian noise."""
    count = how.weights.size
    found: list[tuple[str, str, np.ndarray]] = []
    for ratio in _RATIOS:
        for place, axis in enumerate("xyz"):
            spread = np.ones_like(how.weights)
            spread[:, place] = ratio
            found.append(("noise_unequal", f"sd of axis {axis} times {ratio:g}", spread.ravel() ** 2))
    if how.known:
        found += [("noise_unequal", f"every sd times {level:g}", np.full(count, level**2)) for level in _LEVELS]
    share = np.log(NOISE_WEIGHT / _LABELS / len(found))
    listed = [alternative(linear, label, words, share, covariance) for label, words, covariance in found]
    for label, family in _families(linear, how, where).items():
        share = np.log(NOISE_WEIGHT / _LABELS / len(family.levels))
        for level in family.levels:
            one = alternative(linear, label, family.words(level, 1.0), share, family.covariance(level))
            listed.append(replace(one, family=family, level=level))
    weight = np.log(NOISE_WEIGHT / _LABELS / len(_TAILS))
    listed += [
        NoiseAlternative(
            "noise_heavy_tail",
            f"Student's t with {tail:g} degrees of freedom",
            weight,
            linear.basis[:count],
            0.0,
            np.ones(count),
            tail,
        )
        for tail in _TAILS
    ]
    return listed


def _families(linear: Linear, how: Weighting, where: Where) -> dict[str, Family]:
    unit = float(np.median(how.weights))
    return {
        "noise_coloured": Family(
            lambda level: coloured(where, level),
            _CORRELATIONS,
            lambda level, sigma: f"correlation {level:.2g} between neighbouring positions",
        ),
        "noise_attitude": Family(
            lambda level: attitude(linear, how, level / unit),
            _ATTITUDES,
            lambda level, sigma: (
                f"the attitude scatters by {level * sigma / unit * 1e3:.2g} mrad from position to position"
            ),
        ),
    }


def alternative(linear: Linear, label: str, words: str, log_weight: float, covariance: np.ndarray) -> NoiseAlternative:
    """A Gaussian alternative with this covariance of the weighted rows (a diagonal or a matrix)."""
    count = len(covariance)
    part = linear.basis[:count]
    spread = part * covariance[:, None] if covariance.ndim == 1 else covariance @ part
    inner = part.T @ spread + linear.basis[count:].T @ linear.basis[count:]
    lower = np.linalg.cholesky(inner)
    whiten = solve_triangular(lower, np.eye(len(lower)), lower=True)
    half_log_det = float(np.sum(np.log(np.diag(lower))))
    return NoiseAlternative(label, words, log_weight, whiten, half_log_det, covariance)


def measuring_order(where: Where) -> Float[np.ndarray, " positions"]:
    """Time in median steps between positions: from time_s where there is one, else the order of the rows."""
    count = len(np.asarray(where.alpha))
    if where.time_s is None or np.ptp(np.asarray(where.time_s)) == 0:
        return np.arange(count, dtype=float)
    time = np.asarray(where.time_s, float)
    # A pause (another day) is no reason to take neighbours for simultaneous.
    step = float(np.median(np.diff(np.sort(time)))) or np.ptp(time) / (count - 1)
    return (time - time.min()) / step


def coloured(where: Where, correlation: float) -> Float[np.ndarray, "rows rows"]:
    """Covariance of exponentially correlated noise, independent axes, variance one."""
    time = measuring_order(where)
    matrix = correlation ** np.abs(time[:, None] - time[None, :])
    return np.kron(matrix, np.eye(3))


def attitude(linear: Linear, how: Weighting, scatter: float) -> Float[np.ndarray, "rows rows"]:
    """Covariance of the weighted rows where every position's attitude is off by a random rotation.

    A small rotation w moves the reading by w x f: whatever its distribution about the vertical, the error is perpendicular
    to f, of variance `scatter^2` (rad^2, g = 1) in both directions. White noise of variance one is added.
    """
    f = linear.evaluation.inputs
    count = len(f)
    joint = np.zeros((count, 3, count, 3))
    across = np.sum(f**2, axis=1)[:, None, None] * np.eye(3) - f[:, :, None] * f[:, None, :]
    joint[np.arange(count), :, np.arange(count), :] = (
        across * how.weights[:, :, None] * how.weights[:, None, :] * scatter**2
    )
    matrix = joint.reshape(3 * count, 3 * count)
    if how.whiten is not None:
        matrix = how.whiten @ matrix @ how.whiten.T
    return matrix + np.eye(3 * count)


def log_noise_evidence(
    listed: list[NoiseAlternative], z: Float[np.ndarray, "draws nu"], known: bool
) -> Float[np.ndarray, "draws alternatives"]:
    """Log evidence with prior weight, on the scale of `evidence.log_evidence`."""
    dof = z.shape[1]
    columns = []
    for one in listed:
        rows = z @ one.whiten.T
        if one.tail is not None:
            columns.append(one.log_weight + _heavy(rows, z, one.tail, known))
            continue
        quadratic = np.sum(rows**2, axis=1)
        if known:
            columns.append(one.log_weight - one.half_log_det - 0.5 * quadratic)
        else:
            variance = quadratic / dof
            score = -0.5 * dof * np.log(variance) - 0.5 * dof + 0.5 * np.log(np.pi / dof)
            columns.append(one.log_weight - one.half_log_det + score)
    return np.stack(columns, axis=1)


def _heavy(rows: np.ndarray, z: np.ndarray, tail: float, known: bool) -> np.ndarray:
    """Student's t against the normal on the readings' residuals, each with its own best scale (profile likelihood)."""
    count, dof = rows.shape[1], z.shape[1]
    total = np.sum(z**2, axis=1)
    variance = total / dof
    normal = -0.5 * total if known else -0.5 * dof * np.log(variance) - 0.5 * dof + 0.5 * np.log(np.pi / dof)
    scale = np.full(len(rows), 0.5) * variance if not known else np.ones(len(rows))
    for _ in range(8 if not known else 0):
        trust = (tail + 1) / (tail + rows**2 / scale[:, None])
        scale = np.sum(trust * rows**2, axis=1) / count
    scale = np.maximum(scale, 1e-12 * np.maximum(variance, 1e-300))
    constant = gammaln((tail + 1) / 2) - gammaln(tail / 2) - 0.5 * np.log(tail * np.pi)
    student = np.sum(
        constant - 0.5 * np.log(scale)[:, None] - 0.5 * (tail + 1) * np.log1p(rows**2 / scale[:, None] / tail), axis=1
    )
    spread = np.ones(len(rows)) if known else np.sum(rows**2, axis=1) / count
    gaussian = np.sum(-0.5 * np.log(2 * np.pi * spread)[:, None] - 0.5 * rows**2 / spread[:, None], axis=1)
    # The t's likelihood is that of `count` residuals which have only `dof` dimensions.
    return normal + (student - gaussian) * dof / count
