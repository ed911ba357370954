"""Alternatives about the noise, the mean being right: unequal axes, coloured in time, heavy tails, attitude.

Rows that repeat an attitude tell pure error from lack of fit (Draper and Smith 1998, section 2.1): what comes back in
every repeat is none of these, but an error of the model that no cause of the list describes. It is weighed beside them as
a covariance that the repeats of an attitude share.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import gammaln

from tumblecal.diagnosis.evidence import log_evidence_of_noise
from tumblecal.diagnosis.generic_causes import UNEXPLAINED
from tumblecal.diagnosis.noise_covariances import across, attitude, coloured
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import GENERIC_WEIGHT, LEVEL_WEIGHT, NOISE_WEIGHT
from tumblecal.effects import AXES
from tumblecal.ground.showing import brief
from tumblecal.noise.covariance import Covariance


_RATIOS = (0.25, 0.5, 2.0, 3.0, 5.0, 9.0)
# By how much a stated sd may be wrong: any factor between these, its logarithm uniform.
_LEAST_FACTOR, _MOST_FACTOR = 0.1, 100.0
_CORRELATIONS = (0.3, 0.5, 0.7, 0.85, 0.95)
_TAILS = (2.0, 4.0)
# Scatter of the attitude from position to position, in noise standard deviations of a reading, for 1 g.
_ATTITUDES = (2.0, 5.0, 15.0, 50.0, 200.0)
# Size of an attitude's own error that comes back, in noise standard deviations.
_MISFITS = (0.7, 1.5, 3.0, 8.0, 30.0)
# Kinds of alternatives, which share the weight of all: unequal axes, colour, tails, attitude.
_KINDS = 4
LEVEL = "level"


@dataclass(frozen=True)
class Family:
    """Noise models that differ by a number.

    `covariance` of the weighted rows at a level; the `levels` tried; `words` for a level and the sd of the weighted rows.
    """

    covariance: Callable[[float], Covariance]
    levels: tuple[float, ...]
    words: Callable[[float, float], str]


class Spectrum(NamedTuple):
    """A covariance `turn diag(sd^2) turn'`."""

    turn: Float[np.ndarray, "nu nu"]
    sd: Float[np.ndarray, " nu"]


@dataclass(frozen=True)
class NoiseAlternative:
    """Another distribution of the noise.

    - `label`: catalogue id; `words`: which one; `log_weight`: prior.
    - `covariance`: of the readings' white rows. `basis` (rows, nu): of the residual space.
    - `nominal`: white orthonormal basis of what the nominal model reaches. Where that is more than it leaves (free tilts):
      None, and `spectrum` is that of the covariance on the residual space.
    - `half_log_det`: of the covariance on the residual space.
    - `family`: where it is one of a continuous family, the covariance by `level`, which may be refined.
    - `tail`: degrees of freedom of Student's t where single readings have heavy tails.
    - `kind`: what tells it from others of the same label, `LEVEL` where the sd of all readings is off by one factor,
      whatever it is: the noise counts as unknown.
    """

    __repr__ = brief

    label: str
    words: str
    log_weight: float
    covariance: Covariance
    basis: Float[np.ndarray, "rows nu"]
    nominal: Float[np.ndarray, "rows parameters"] | None
    spectrum: Spectrum | None
    half_log_det: float
    tail: float | None = None
    family: Family | None = None
    level: float = 1.0
    kind: str = ""

    def whitened(self, rows: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "white columns"]:
        """Rows of the residual made white, what the nominal model can reach of them taken out."""
        if self.spectrum is not None:
            return self.spectrum.turn.T @ (self.basis.T @ rows) / self.spectrum.sd[:, None]
        assert self.nominal is not None
        white = self.covariance.whiten(rows)
        return white - self.nominal @ (self.nominal.T @ white)

    @cached_property
    def white_basis(self) -> Float[np.ndarray, "white nu"]:
        """The residual space's basis made white."""
        return self.whitened(self.basis)


def noise_alternatives(at: Tangent) -> list[NoiseAlternative]:
    """The noise models that are tried against equal, white, Gaussian noise."""
    problem, count = at.problem, at.problem.readings.size
    weight, axes = np.log(NOISE_WEIGHT / _KINDS), []
    for ratio in _RATIOS:
        for axis in range(3):
            spread = np.ones(problem.readings.shape)
            spread[:, axis] = ratio
            axes.append(("noise_unequal", f"sd of axis {AXES[axis]} times {ratio:g}", spread.ravel() ** 2))
    listed = _diagonal(at, weight - np.log(len(axes)), axes)
    if problem.known:
        share = np.log(LEVEL_WEIGHT) - np.log(np.log(_MOST_FACTOR / _LEAST_FACTOR))
        of_all = _diagonal(at, share, [("noise_unequal", "every sd times one factor", np.ones(count))])
        listed += [replace(tried, kind=LEVEL) for tried in of_all]
    for label, family in _families(at).items():
        share = weight - np.log(len(family.levels))
        for level in family.levels:
            tried = alternative_of(at, label, family.words(level, 1.0), share, family.covariance(level))
            listed.append(replace(tried, family=family, level=level))
    heavy = [("noise_heavy_tail", f"Student's t with {tail:g} degrees of freedom", np.ones(count)) for tail in _TAILS]
    listed += _misfits(at)
    tails = zip(_TAILS, _diagonal(at, weight - np.log(len(_TAILS)), heavy), strict=True)
    return [*listed, *(replace(student, tail=tail) for tail, student in tails)]


def _families(at: Tangent) -> dict[str, Family]:
    unit, time = float(np.median(1.0 / at.problem.sd)), at.problem.where.measuring_order
    of_attitude = across(at)
    families = {
        "noise_coloured": Family(
            lambda level: coloured(time, level),
            _CORRELATIONS,
            lambda level, sigma: f"correlation {level:.2g} between neighbouring positions",
        ),
        "noise_attitude": Family(
            lambda level: attitude(of_attitude, at.problem, level / unit),
            _ATTITUDES,
            lambda level, sigma: (
                f"the attitude scatters by {level * sigma / unit * 1e3:.2g} mrad from position to position"
            ),
        ),
    }
    if at.model.hand_held:
        # Its own tilts take up whatever a position's attitude does.
        del families["noise_attitude"]
    return families


def _diagonal(at: Tangent, log_weight: float, listed: list[tuple[str, str, np.ndarray]]) -> list[NoiseAlternative]:
    """`alternative_of` for many diagonal covariances at once."""
    covariances = [Covariance(variances, "rows") for _, _, variances in listed]
    if at.reached.shape[1] > at.dof:
        return [
            _on_residuals(at, (label, words, log_weight, covariance), spectrum)
            for (label, words, _), covariance, spectrum in zip(
                listed, covariances, _spectra(at, covariances), strict=True
            )
        ]
    count = covariances[0].count
    roots = np.stack([covariance.root for covariance in covariances])
    white = np.repeat(at.reached[None], len(listed), axis=0)
    white[:, :count] /= roots[:, :, None]
    lower = np.linalg.cholesky(np.swapaxes(white, 1, 2) @ white)
    log_dets = np.sum(np.log(roots), axis=1) + np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
    nominal = np.swapaxes(np.linalg.solve(lower, np.swapaxes(white, 1, 2)), 1, 2)
    return [
        NoiseAlternative(label, words, log_weight, covariance, at.basis, own, None, float(log_det))
        for (label, words, _), covariance, own, log_det in zip(listed, covariances, nominal, log_dets, strict=True)
    ]


def alternative_of(at: Tangent, label: str, words: str, log_weight: float, covariance: Covariance) -> NoiseAlternative:
    """A Gaussian alternative with this covariance of the white rows."""
    told = label, words, log_weight, covariance
    if at.reached.shape[1] > at.dof:
        readings, priors = np.split(at.basis, [covariance.count])
        variances, turn = np.linalg.eigh(readings.T @ covariance.times(readings) + priors.T @ priors)
        return _on_residuals(at, told, Spectrum(turn, np.sqrt(variances)))
    white = covariance.whiten(at.reached)
    lower = np.linalg.cholesky(white.T @ white)
    # The determinant on the residual space: the whole, times that of the precision on what the nominal model reaches.
    log_det = covariance.half_log_det + float(np.sum(np.log(np.diag(lower))))
    return NoiseAlternative(*told, at.basis, np.linalg.solve(lower, white.T).T, None, log_det)


def _on_residuals(at: Tangent, told: tuple[str, str, float, Covariance], spectrum: Spectrum) -> NoiseAlternative:
    """An alternative by its covariance on the residual space."""
    return NoiseAlternative(*told, at.basis, None, spectrum, float(np.sum(np.log(spectrum.sd))))


def _spectra(at: Tangent, covariances: list[Covariance]) -> Iterator[Spectrum]:
    """On the residual space, of diagonal covariances that are one but for some rows with one
    variance; those with the same rows share the directions."""
    shares: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    for covariance in covariances:
        changed = covariance.values != 1.0
        if changed.tobytes() not in shares:
            rows = at.basis[: covariance.count][changed]
            share, turn = np.linalg.eigh(rows.T @ rows)
            shares[changed.tobytes()] = share, turn
        share, turn = shares[changed.tobytes()]
        variance = covariance.values[changed][0] if np.any(changed) else 1.0
        yield Spectrum(turn, np.sqrt(1.0 + (variance - 1.0) * share))


def _misfits(at: Tangent) -> list[NoiseAlternative]:
    """Every attitude has an error of its own that comes back in its repeats; none where no row repeats another's."""
    attitude, weights = at.problem.where.attitude, np.mean(at.problem.sd, axis=1)
    repeats = attitude[:, None] == attitude
    if at.model.hand_held or np.all(np.sum(repeats, axis=1) == 1):
        return []
    shared = repeats * np.outer(np.median(weights) / weights, np.median(weights) / weights)
    share = float(np.log(GENERIC_WEIGHT / len(_MISFITS)))
    words = "the attitude and, as it comes back where one is repeated, is no noise"
    return [
        alternative_of(at, UNEXPLAINED, words, share, Covariance(size**2 * shared + np.eye(len(shared)), "between"))
        for size in _MISFITS
    ]


def log_noise_evidence(
    listed: list[NoiseAlternative], z: Float[np.ndarray, "draws nu"], known: bool
) -> Float[np.ndarray, "draws alternatives"]:
    """Log evidence with prior weight, on the scale of `evidence.log_evidence`."""
    dof, evidence = z.shape[1], np.zeros((len(listed), len(z)))
    if not listed:
        return evidence.T
    rows = listed[0].basis @ z.T
    gaussian = [k for k, tried in enumerate(listed) if tried.tail is None and tried.kind != LEVEL]
    for k, tried in enumerate(listed):
        if tried.kind == LEVEL:
            evidence[k] = log_evidence_of_noise(np.sum(z**2, axis=1), dof, known=False)
        if tried.tail is not None:
            evidence[k] = _heavy(rows[: tried.covariance.count].T, z, tried.tail, known)
    if gaussian:
        quadratic = _quadratic([listed[k] for k in gaussian], rows, z)
        half_log_dets = np.array([listed[k].half_log_det for k in gaussian])
        evidence[gaussian] = log_evidence_of_noise(quadratic, dof, known) - half_log_dets[:, None]
    return (evidence + np.array([tried.log_weight for tried in listed])[:, None]).T


def _quadratic(
    listed: list[NoiseAlternative], rows: Float[np.ndarray, "rows draws"], z: Float[np.ndarray, "draws nu"]
) -> Float[np.ndarray, "alternatives draws"]:
    """Sum of squares of the rows made white by each alternative, what the nominal model can reach of them taken out."""
    squares, count = np.empty((len(listed), len(z))), listed[0].covariance.count
    reached = {
        k: tried.nominal
        for k, tried in enumerate(listed)
        if tried.nominal is not None and tried.covariance.form == "rows"
    }
    if diagonal := list(reached):
        roots = np.ones((len(diagonal), len(rows)))
        roots[:, :count] = [listed[k].covariance.root for k in diagonal]
        reach = np.stack(list(reached.values())) / roots[:, :, None]
        along = (np.swapaxes(reach, 1, 2).reshape(-1, len(rows)) @ rows).reshape(len(diagonal), -1, len(z))
        squares[diagonal] = (1.0 / roots**2) @ rows**2 - np.sum(along**2, axis=1)
    turned: dict[int, np.ndarray] = {}
    for k, tried in enumerate(listed):
        if tried.spectrum is not None:
            turn, sd = tried.spectrum
            if id(turn) not in turned:
                turned[id(turn)] = (z @ turn) ** 2
            squares[k] = turned[id(turn)] @ (1.0 / sd**2)
        elif k not in reached:
            # Of many draws the basis is made white once: they come in chunks.
            white = tried.white_basis @ z.T if 4 * len(z) > z.shape[1] else tried.whitened(rows)
            squares[k] = np.einsum("rd,rd->d", white, white)
    return squares


def _heavy(rows: np.ndarray, z: np.ndarray, tail: float, known: bool) -> np.ndarray:
    """Student's t against the normal on the readings' residuals, each with its own best scale (profile likelihood)."""
    count, dof = rows.shape[1], z.shape[1]
    total = np.sum(z**2, axis=1)
    variance = total / dof
    normal = log_evidence_of_noise(total, dof, known)
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
