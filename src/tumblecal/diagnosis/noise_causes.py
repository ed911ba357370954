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
    """Rows made white by each covariance, those of one form at once."""
    white = np.repeat(rows[None], len(covariances), axis=0)
    count, forms = covariances[0].count, [covariance.form for covariance in covariances]
    readings = rows[:count].reshape(count // 3, 3, -1)
    for form in set(forms):
        own = [k for k, other in enumerate(forms) if other == form]
        if form == "rows":
            white[own, :count] /= np.stack([covariances[k].root for k in own])[:, :, None]
        elif form in ("between", "blocks"):
            right = readings.reshape(count // 3, -1) if form == "between" else readings
            solved = np.linalg.solve(np.stack([covariances[k].root for k in own]), right)
            white[own, :count] = solved.reshape(len(own), count, -1)
        else:
            white[own] = [covariances[k].whiten(rows) for k in own]
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
    if tailed := [k for k, tried in enumerate(listed) if tried.tail is not None]:
        tails = np.array([listed[k].tail for k in tailed], float)
        evidence[tailed] = _heavy(rows[: listed[0].covariance.count].T, z, tails, known)
    if gaussian:
        quadratic = _quadratic([listed[k] for k in gaussian], rows, z)
        half_log_dets = np.array([listed[k].half_log_det for k in gaussian])
        evidence[gaussian] = log_evidence_of_noise(quadratic, dof, known) - half_log_dets[:, None]
    return (evidence + np.array([tried.log_weight for tried in listed])[:, None]).T


def _quadratic(
    listed: list[NoiseAlternative], rows: Float[np.ndarray, "rows draws"], z: Float[np.ndarray, "draws nu"]
) -> Float[np.ndarray, "alternatives draws"]:
    """Sum of squares of the rows made white by each alternative, what the nominal model can reach of them taken out."""
    if 4 * len(z) <= z.shape[1] and (nominal := [tried.nominal for tried in listed if tried.nominal is not None]):
        white = _whitened(rows, [tried.covariance for tried in listed])
        along = np.swapaxes(np.stack(nominal), 1, 2) @ white
        return np.sum(white**2, axis=1) - np.sum(along**2, axis=1)
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
            white = tried.white_basis @ z.T
            squares[k] = np.einsum("rd,rd->d", white, white)
    return squares


def _heavy(
    rows: Float[np.ndarray, "draws readings"],
    z: Float[np.ndarray, "draws nu"],
    tails: Float[np.ndarray, " tails"],
    known: bool,
) -> Float[np.ndarray, "tails draws"]:
    """Student's t against the normal on the readings' residuals, each with its own best scale (profile likelihood)."""
    count, dof, squares, tail = rows.shape[1], z.shape[1], rows**2, tails[:, None, None]
    total = np.sum(z**2, axis=1)
    variance = total / dof
    scale = np.ones((len(tails), len(rows))) if known else np.tile(0.5 * variance, (len(tails), 1))
    for _ in range(8 if not known else 0):
        trust = (tail + 1) / (tail + squares / scale[:, :, None])
        scale = np.sum(trust * squares, axis=2) / count
    scale = np.maximum(scale, 1e-12 * np.maximum(variance, 1e-300))
    constant = gammaln((tails + 1) / 2) - gammaln(tails / 2) - 0.5 * np.log(tails * np.pi)
    student = -0.5 * (tails[:, None] + 1) * np.sum(np.log1p(squares / scale[:, :, None] / tail), axis=2)
    student += count * (constant[:, None] - 0.5 * np.log(scale))
    spread = np.ones(len(rows)) if known else np.sum(squares, axis=1) / count
    gaussian = -0.5 * count * np.log(2 * np.pi * spread) - 0.5 * np.sum(squares, axis=1) / spread
    # The t's likelihood is that of `count` residuals which have only `dof` dimensions.
    return log_evidence_of_noise(total, dof, known) + (student - gaussian) * dof / count
