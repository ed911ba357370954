"""Alternatives about the noise, the mean being right: noise models on the residual space, and the evidence for them."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import gammaln

from tumblecal.diagnosis.evidence import log_evidence_of_noise
from tumblecal.diagnosis.noise_models import LEVEL, NoiseModel, noise_models
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.ground.showing import brief
from tumblecal.noise.covariance import Covariance


class Spectrum(NamedTuple):
    """A covariance `turn diag(sd^2) turn'`."""

    turn: Float[np.ndarray, "nu nu"]
    sd: Float[np.ndarray, " nu"]


@dataclass(frozen=True, kw_only=True)
class NoiseAlternative(NoiseModel):
    """A noise model on the residual space of a problem.

    - `basis` (rows, nu): of the residual space.
    - `nominal`: white orthonormal basis of what the nominal model reaches. Where that is more than it leaves (free tilts):
      None, and `spectrum` is that of the covariance on the residual space.
    - `half_log_det`: of the covariance on the residual space.
    """

    __repr__ = brief

    basis: Float[np.ndarray, "rows nu"]
    nominal: Float[np.ndarray, "rows parameters"] | None
    spectrum: Spectrum | None
    half_log_det: float

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
    return _alternatives(at, noise_models(at))


def alternative_of(at: Tangent, label: str, words: str, log_weight: float, covariance: Covariance) -> NoiseAlternative:
    """A Gaussian alternative with this covariance of the white rows."""
    return _alternatives(at, [NoiseModel(label, words, log_weight, covariance)])[0]


def _alternatives(at: Tangent, listed: list[NoiseModel]) -> list[NoiseAlternative]:
    """The alternatives of a problem with these covariances."""
    if at.reached.shape[1] > at.dof:
        spectra = list(_spectra(at, [model.covariance for model in listed]))
        nominal, log_dets = [None] * len(listed), [float(np.sum(np.log(spectrum.sd))) for spectrum in spectra]
    else:
        white = _whitened(at.reached, [model.covariance for model in listed])
        lower = np.linalg.cholesky(np.swapaxes(white, 1, 2) @ white)
        spectra, nominal = [None] * len(listed), white @ np.swapaxes(np.linalg.inv(lower), 1, 2)
        # The determinant on the residual space: the whole, times that of the precision on what the nominal model reaches.
        precision = np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
        log_dets = [model.covariance.half_log_det + own for model, own in zip(listed, precision.tolist(), strict=True)]
    return [
        NoiseAlternative(**vars(model), basis=at.basis, nominal=reached, spectrum=spectrum, half_log_det=log_det)
        for model, reached, spectrum, log_det in zip(listed, nominal, spectra, log_dets, strict=True)
    ]


def _whitened(
    rows: Float[np.ndarray, "rows columns"], covariances: list[Covariance]
) -> Float[np.ndarray, "covariances rows columns"]:
    """Rows made white by each covariance."""
    white = np.repeat(rows[None], len(covariances), axis=0)
    diagonal = [k for k, covariance in enumerate(covariances) if covariance.form == "rows"]
    if diagonal:
        white[diagonal, : covariances[0].count] /= np.stack([covariances[k].root for k in diagonal])[:, :, None]
    for k, covariance in enumerate(covariances):
        if covariance.form != "rows":
            white[k] = covariance.whiten(rows)
    return white


def _spectra(at: Tangent, covariances: list[Covariance]) -> Iterator[Spectrum]:
    """Those of covariances on the residual space; diagonal ones that are one but for some rows with one variance share the
    directions of these rows."""
    shares: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    for covariance in covariances:
        changed = covariance.values != 1.0
        if covariance.form != "rows" or len(np.unique(covariance.values[changed])) > 1:
            readings, priors = np.split(at.basis, [covariance.count])
            variances, turn = np.linalg.eigh(readings.T @ covariance.times(readings) + priors.T @ priors)
            yield Spectrum(turn, np.sqrt(variances))
            continue
        if changed.tobytes() not in shares:
            rows = at.basis[: covariance.count][changed]
            share, turn = np.linalg.eigh(rows.T @ rows)
            shares[changed.tobytes()] = share, turn
        share, turn = shares[changed.tobytes()]
        variance = covariance.values[changed][0] if np.any(changed) else 1.0
        yield Spectrum(turn, np.sqrt(1.0 + (variance - 1.0) * share))


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
