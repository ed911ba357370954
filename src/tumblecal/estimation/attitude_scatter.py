"""Attitudes set by hand: their scatter about the angles of the file, estimated together with the noise.

A tilt of a position moves its reading across gravity to first order, and along gravity only to second order. With one tilt
in two directions for each position as parameters of the fit, with a common prior standard deviation, readings along
gravity have their full weight: six faces give bias and scale factor as pairs of faces do.

Rule: unless it is stated how the attitudes were set, tilts are used if they explain the readings better than noise of any
size does, by odds of `LEAST_ODDS` (log), if they are larger than the errors of a head and smaller than steps between
positions (`LEAST_TILT`, `MOST_TILT`), if all positions have them, and if no stated noise is contradicted. Tilt and noise have
log-normal prior distributions, and the root mean square of each over the posterior is in use, so intervals are correct for few
positions too.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.chain.nominal import LINKS, NOMINAL, FreeAttitude, nominal_link
from tumblecal.data.position_comments import BY_HAND
from tumblecal.data.sensor_parameters import leaf_of
from tumblecal.estimation import exact
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import matrix_and_bias, one_sensor
from tumblecal.estimation.problem import Problem
from tumblecal.noise.covariance import Covariance
from tumblecal.words import sentence


_NOMINAL = {LINKS[name].kind for name in NOMINAL}
# Log odds of tilts against noise alone from which they are used.
LEAST_ODDS = 1.0
# Smaller errors of the attitude are those of a dividing head, or of a mounting that moved; larger ones are other positions.
LEAST_TILT, MOST_TILT = float(np.radians(0.05)), float(np.radians(5.0))
# Noise of this multiple of the stated one, in addition to tilts, has another cause.
_MOST_NOISE = 4.0
# More positions than these are not set by hand.
_MOST_POSITIONS = 200
# The grid of a posterior: points along each size, prior standard deviations that it spans at first, and log density below the
# maximum beyond which it ends.
_POINTS, _SPANNED, _NEGLIGIBLE = 17, 8.0, 12.0
_MOST_GRIDS, _MOST_FITS = 6, 8
# Sizes have settled when none changes by more than this share.
_SETTLED = 0.02
# A grid is fine enough when its range shrinks no further than to this share.
_SHRUNK = 0.5
# The data determine the noise if they reduce the standard deviation of its logarithm to this share of the prior's.
_DETERMINED = 0.5
# Root mean square of tilts over their robust standard deviation beyond which few positions have them all; below 2 for a
# normal distribution, even of twelve.
_OUTLYING = 3.0


class Size(NamedTuple):
    """Prior of a size: median, and standard deviation of the natural logarithm; 0 for a known size."""

    median: float
    spread: float


# A position set by hand is tilted by 0.05 to 5 deg. The noise of a mean is 0.01 to 3 mg, and a stated one is correct within a
# factor of 4. (by thought; coverage: benchmarks/blind hand)
TILT, NOISE = Size(float(np.radians(0.5)), float(np.log(3.0))), Size(0.2e-3, float(np.log(4.0)))
_STATED_SPREAD = float(np.log(2.0))


@dataclass(frozen=True)
class AttitudeScatter:
    """Scatter of the attitudes about the angles of the file.

    - `tilt_rad`: standard deviation of the tilt of a position in each of two directions, rad. `noise`: factor of the noise of
      the problem; 1 if it is stated. `noise_g`: sd of a reading, g.
    - `log_odds`: against noise alone. `stated`: whether it is stated that the attitudes were set by hand.
    - `noise_determined`: whether the noise is stated, or shown by these positions; otherwise it is the assumed one.
    """

    tilt_rad: float
    noise: float
    noise_g: float
    log_odds: float
    stated: bool
    noise_determined: bool = True

    @property
    def size_words(self) -> str:
        """The size, as a fault of the noise."""
        size = f"{self.tilt_rad * 1e3:.2g} mrad ({np.degrees(self.tilt_rad):.2g} deg)"
        return f"the attitude scatters by {size} from position to position"

    @property
    def words(self) -> str:
        """Size and reason, and how to override it."""
        odds = float(np.exp(min(self.log_odds, 100.0)))
        return sentence("noise/attitudes", n=self, tilt_deg=np.degrees(self.tilt_rad), odds=odds)

    def applied(self, problem: Problem) -> Problem:
        """The problem with two tilts for each position, with this prior standard deviation, and with this noise."""
        if not problem.known:
            problem = problem.with_noise(Covariance.of_sd(self.noise * problem.sd), known=False)
        return problem.with_links(nominal_link("free_attitude", problem.where, {})).with_prior_sd("tilt", self.tilt_rad)


def fit_with_scatter(fit: Fit, least_odds: float = LEAST_ODDS) -> tuple[Fit, AttitudeScatter] | None:
    """The exact fit with tilts, and their size; None if they are not used.

    **Arguments:**

    - `fit`: exact, of a problem without tilts.
    - `least_odds`: log odds against noise alone from which tilts are used, if it is not stated that they were set by hand.
    """
    problem, stated = fit.problem, fit.data.attitudes
    described = [link for link in problem.chain.links if type(link) not in _NOMINAL]
    free = any(isinstance(link, FreeAttitude) for link in described)
    if free or stated not in (None, BY_HAND) or not (fit.code.good and one_sensor(fit)):
        return None
    # Effects and priors describe a head.
    of_head = bool(described) or problem.with_prior or len(problem.readings) > _MOST_POSITIONS
    if stated is None and (of_head or fit.computed):
        return None
    rows, level = _around(fit), 1.0 if problem.known else NOISE.median / float(np.median(problem.sd))
    noise = Size(level, _STATED_SPREAD if problem.known else NOISE.spread)
    with_tilts = _posterior(rows, noise, TILT)
    log_odds = with_tilts.log_evidence - _posterior(rows, noise, Size(0.0, 0.0)).log_evidence
    # The decision admits any noise; a stated one is then used.
    noise = Size(1.0, 0.0) if problem.known else noise
    found = _posterior(rows, noise, TILT)
    contradicted = problem.known and with_tilts.noise > _MOST_NOISE
    usual = LEAST_TILT <= found.tilt <= MOST_TILT and not contradicted
    if stated is None and not (log_odds >= least_odds and usual):
        return None
    fits = 0
    while True:
        # A tilt acts along gravity in second order: the linearisation is repeated around the estimates.
        noise_g, determined = (
            found.noise * float(np.median(problem.sd)),
            found.noise_spread <= _DETERMINED * noise.spread,
        )
        scatter = AttitudeScatter(found.tilt, found.noise, noise_g, log_odds, stated == BY_HAND, determined)
        fit, before, fits = exact.fit(scatter.applied(problem)), found, fits + 1
        found = _posterior(_around(fit, scatter.noise), noise, TILT)
        changed = max(abs(found.tilt / before.tilt - 1), abs(found.noise / before.noise - 1))
        if changed < _SETTLED or fits == _MOST_FITS:
            return (fit, scatter) if stated or (fit.code.good and not _of_few_positions(fit)) else None


def _are_tilts(fit: Fit) -> Bool[np.ndarray, " parameters"]:
    return np.array([leaf_of(name) == "tilt" for name in fit.names], bool)


def _of_few_positions(fit: Fit) -> bool:
    """Whether the tilts of a fit are those of a few positions, such as exchanged ones, and not a scatter of all."""
    tilts = np.abs(fit.values[_are_tilts(fit)])
    return bool(np.sqrt(np.mean(tilts**2)) > _OUTLYING * 1.4826 * np.median(tilts))


class _Rows(NamedTuple):
    """Linear model of white rows in coordinates in which tilts are independent: residual, design, and the variance that a tilt
    of 1 rad adds to each row. `measured`: how many rows are readings; those of priors follow."""

    residual: Float[np.ndarray, " rows"]
    design: Float[np.ndarray, "rows parameters"]
    of_tilt: Float[np.ndarray, " rows"]
    measured: int

    @classmethod
    def of(
        cls,
        problem: Problem,
        residual: Float[np.ndarray, " rows"],
        design: Float[np.ndarray, "rows parameters"],
        slopes: Float[np.ndarray, "readings tilts"],
    ) -> "_Rows":
        """From white rows; `slopes`: of those of the readings by the tilts of all positions, per rad."""
        count, positions = problem.readings.size, len(problem.readings)
        blocks = slopes[None]
        if not problem.correlated:
            blocks = np.einsum("piqj,pq->pij", slopes.reshape(positions, 3, positions, 2), np.eye(positions))
        variance, axes = np.linalg.eigh(blocks @ blocks.swapaxes(1, 2))
        rows = np.column_stack([residual, design])
        turned = axes.swapaxes(1, 2) @ rows[:count].reshape(len(blocks), -1, rows.shape[1])
        rows = np.concatenate([turned.reshape(count, -1), rows[count:]])
        of_tilt = np.concatenate([np.maximum(variance.ravel(), 0.0), np.zeros(len(rows) - count)])
        return cls(rows[:, 0], rows[:, 1:], of_tilt, count)

    def log_likelihood(
        self, noise: Float[np.ndarray, " sizes"], tilt: Float[np.ndarray, " sizes"]
    ) -> Float[np.ndarray, " sizes"]:
        """Restricted log likelihood (Patterson and Thompson 1971) for noise (factor) and tilt (rad) of these sizes."""
        variance = np.where(np.arange(len(self.residual)) < self.measured, noise[:, None] ** 2, 1.0)
        variance = variance + tilt[:, None] ** 2 * self.of_tilt
        # By the triangle of an orthogonal decomposition: the normal equations are singular where tilts hide a parameter.
        rows = np.column_stack([self.design, self.residual]) / np.sqrt(variance)[:, :, None]
        triangle, count = np.asarray(np.linalg.qr(rows, mode="r")), self.design.shape[1]
        log_pivots = np.log(np.abs(np.diagonal(triangle[:, :count, :count], axis1=1, axis2=2)))
        remaining = np.sum(triangle[:, count:, count] ** 2, axis=1)
        return -0.5 * (np.sum(np.log(variance), axis=1) + 2 * np.sum(log_pivots, axis=1) + remaining)


class _Posterior(NamedTuple):
    """Of the sizes: logarithm of the evidence, root mean squares, and standard deviation of the logarithm of the noise."""

    log_evidence: float
    noise: float
    tilt: float
    noise_spread: float


def _posterior(rows: _Rows, noise: Size, tilt: Size) -> _Posterior:
    """The posterior on a grid of the logarithms of the sizes, refined around its maximum."""
    medians, spreads = np.array([(np.log(max(size.median, 1e-300)), size.spread) for size in (noise, tilt)]).T[
        :, :, None
    ]
    free, bounds = spreads[:, 0] > 0, medians + _SPANNED * spreads * [-1, 1]

    def on_grid() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points, their steps and log density within the bounds."""
        axes = [np.linspace(low, high, _POINTS if high > low else 1) for low, high in bounds.tolist()]
        points = np.stack([values.ravel() for values in np.meshgrid(*axes, indexing="ij")])
        deviations = (points[free] - medians[free]) / spreads[free]
        log_prior = -0.5 * deviations**2 - np.log(spreads[free] * np.sqrt(2 * np.pi))
        return (
            points,
            np.ptp(bounds, axis=1) / (_POINTS - 1),
            rows.log_likelihood(*np.exp(points)) + log_prior.sum(axis=0),
        )

    points, steps, density = on_grid()
    for _ in range(_MOST_GRIDS - 1):
        inside = points[:, density > np.max(density) - _NEGLIGIBLE]
        bounds = np.stack([inside.min(axis=1) - steps, inside.max(axis=1) + steps], axis=1)
        if np.all(np.ptp(bounds, axis=1) >= _SHRUNK * steps * (_POINTS - 1)):
            break
        points, steps, density = on_grid()
    weights = np.exp(density - np.max(density))
    log_evidence = float(np.max(density) + np.log(np.sum(weights) * np.prod(steps[free])))
    weights = weights / np.sum(weights)
    of_noise, of_tilt = np.sqrt(np.exp(2 * points) @ weights).tolist()
    return _Posterior(log_evidence, of_noise, of_tilt, float(np.sqrt(np.cov(points[0], aweights=weights, ddof=0))))


def _around(fit: Fit, noise: float = 1.0) -> _Rows:
    """The rows of a fit linearised at its estimate, in units of the noise of the problem without tilts.

    `noise`: that of the fit in these units. Without tilts in the chain, their effect follows from the fitted sensor.
    """
    tilts = _are_tilts(fit)
    if np.any(tilts):
        slopes = fit.jacobian[:, tilts] / fit.problem.scales[tilts]
        residual, design = fit.rows + slopes @ fit.values[tilts], fit.jacobian[:, ~tilts]
        return _Rows.of(fit.problem, noise * residual, noise * design, noise * slopes[: fit.problem.readings.size])
    matrix, bias, _ = matrix_and_bias(fit)
    forces = (np.asarray(fit.problem.readings) - fit.residuals - bias) @ matrix.T
    # The two directions perpendicular to each force.
    across = np.linalg.svd(forces[:, None, :])[2][:, 1:]
    directions = np.linalg.inv(matrix) @ across.swapaxes(1, 2)
    slopes = np.einsum("pij,pq->piqj", directions, np.eye(len(forces))).reshape(len(forces), 3, -1)
    return _Rows.of(fit.problem, fit.rows, fit.jacobian, np.asarray(fit.problem.rows(slopes)))
