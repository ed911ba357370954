"""Alternatives about the noise, the mean being right: noise models on the residual space, and the evidence for them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaln

from tumblecal.diagnosis.evidence import log_evidence_of_noise
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.diagnosis.noise.models import LEVEL, NoiseModel, noise_models
from tumblecal.diagnosis.noise.of_attitude import twins
from tumblecal.diagnosis.noise.repeats import Repeats
from tumblecal.diagnosis.noise.whitening import Whitening
from tumblecal.ground.showing import brief


@dataclass(frozen=True)
class NoiseAlternatives:
    """Noise models on the residual space of a problem, against equal, white, Gaussian noise."""

    __repr__ = brief

    at: Tangent
    listed: tuple[NoiseModel, ...]

    @cached_property
    def is_gaussian(self) -> Bool[np.ndarray, " alternatives"]:
        """Which of them have no tails."""
        return np.array([tried.tail is None for tried in self.listed], bool)

    @cached_property
    def is_level(self) -> Bool[np.ndarray, " alternatives"]:
        """Which of them leave the level of the noise open."""
        return np.array([tried.kind == LEVEL for tried in self.listed], bool)

    @cached_property
    def log_weights(self) -> Float[np.ndarray, " alternatives"]:
        """Logarithms of the prior weights."""
        return np.array([tried.log_weight for tried in self.listed])

    def without(self, labels: tuple[str, ...]) -> "NoiseAlternatives":
        """The alternatives with other labels than these."""
        if not labels:
            return self
        return NoiseAlternatives(self.at, tuple(tried for tried in self.listed if tried.label not in labels))

    @cached_property
    def whitening(self) -> Whitening:
        """The covariances of those without tails."""
        listed = [tried for tried in self.listed if tried.tail is None]
        of_means = [tried.of_means for tried in listed]
        return Whitening(
            self.at, [tried.covariance for tried in listed], self.repeats if any(of_means) else None, of_means
        )

    @cached_property
    def repeats(self) -> Repeats:
        """Which positions repeat an attitude."""
        return Repeats.of(self.at)

    def log_evidence(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "draws alternatives"]:
        """Log evidence with prior weight, on the scale of `evidence.log_evidence`."""
        evidence, dof, gaussian = np.zeros((len(self.listed), len(z))), z.shape[1], self.is_gaussian
        if np.any(gaussian):
            squares = self.whitening.squares(z.T)
            evidence[gaussian] = log_evidence_of_noise(squares, dof, known) - self.whitening.half_log_dets[:, None]
        if np.any(self.is_level):
            evidence[self.is_level] = log_evidence_of_noise(np.sum(z**2, axis=1), dof, known=False)
        for of_means in (False, True):
            own = np.array([tried.tail is not None and tried.of_means == of_means for tried in self.listed], bool)
            if np.any(own):
                tails = np.array([tried.tail for tried in self.listed])[own].astype(float)
                evidence[own] = self._with_tails(z, tails, known, of_means)
        return (evidence + self.log_weights[:, None]).T

    def _with_tails(
        self, z: Float[np.ndarray, "draws nu"], tails: Float[np.ndarray, " tails"], known: bool, of_means: bool
    ) -> Float[np.ndarray, "tails draws"]:
        """Log evidence of Student's t: of the readings, or of means over repeats whose differences show the scale."""
        readings = self.at.basis[: self.at.problem.readings.size]
        if not of_means:
            return _heavy(z @ readings.T, z, tails, known)
        turned, mean = self.repeats.turned(readings), np.repeat(self.repeats.is_mean, 3)
        means, differences, free = z @ turned[mean].T, z @ turned[~mean].T, float(np.sum(turned[~mean] ** 2))
        total, shown, dof = np.sum(z**2, axis=1), np.sum(differences**2, axis=1), z.shape[1]
        variance, pure = (
            (np.ones(len(z)), np.ones(len(z)))
            if known
            else (total / dof, np.maximum(shown / free, 1e-12 * total / dof))
        )
        gain = _log_t(means, tails, np.broadcast_to(pure, (len(tails), len(z)))) - _log_normal(means, variance)
        pure_gain = -0.5 * (free * np.log(pure / variance) + shown * (1.0 / pure - 1.0 / variance))
        return log_evidence_of_noise(total, dof, known) + pure_gain + gain * (dof - free) / means.shape[1]


def noise_alternatives(at: Tangent) -> NoiseAlternatives:
    """The noise models that are tried against equal, white, Gaussian noise."""
    listed = noise_models(at)
    return NoiseAlternatives(at, (*listed, *twins(at, Repeats.of(at), listed)))


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
    spread = np.ones(len(rows)) if known else np.sum(squares, axis=1) / count
    # The t's likelihood is that of `count` residuals which have only `dof` dimensions.
    gain = _log_t(rows, tails, scale) - _log_normal(rows, spread)
    return log_evidence_of_noise(total, dof, known) + gain * dof / count


def _log_t(
    rows: Float[np.ndarray, "draws readings"],
    tails: Float[np.ndarray, " tails"],
    scale: Float[np.ndarray, "tails draws"],
) -> Float[np.ndarray, "tails draws"]:
    """Log likelihood of Student's t with these degrees of freedom and squared scales."""
    constant = gammaln((tails + 1) / 2) - gammaln(tails / 2) - 0.5 * np.log(tails * np.pi)
    relative = rows**2 / scale[:, :, None] / tails[:, None, None]
    student = -0.5 * (tails[:, None] + 1) * np.sum(np.log1p(relative), axis=2)
    return student + rows.shape[1] * (constant[:, None] - 0.5 * np.log(scale))


def _log_normal(
    rows: Float[np.ndarray, "draws readings"], variance: Float[np.ndarray, " draws"]
) -> Float[np.ndarray, " draws"]:
    """Log likelihood of the normal distribution of these variances."""
    return -0.5 * rows.shape[1] * np.log(2 * np.pi * variance) - 0.5 * np.sum(rows**2, axis=1) / variance
