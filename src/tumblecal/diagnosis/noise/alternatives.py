"""Alternatives about the noise, the mean being right: noise models on the residual space, and the evidence for them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import gammaln

from tumblecal.diagnosis.noise.models import LEVEL, NoiseModel, noise_models
from tumblecal.diagnosis.noise.repeats import Repeats
from tumblecal.diagnosis.noise.whitening import Whitening
from tumblecal.full_model.evidence import log_evidence_of_noise
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


# Steps of the scale of Student's t, each towards the highest likelihood.
_STEPS = 8
# Rows that keep less than this share of a dimension show nothing of the noise.
_LEAST_SHARE = 1e-3


@dataclass(frozen=True)
class NoiseAlternatives:
    """Noise models on the residual space of a problem, against equal, white, Gaussian noise."""

    __repr__ = brief

    at: Tangent
    listed: tuple[NoiseModel, ...]

    @classmethod
    def of(cls, at: Tangent) -> "NoiseAlternatives":
        """The noise models that are tried for a problem."""
        listed = noise_models(at)
        return cls(at, (*listed, *Repeats.of(at).twins(listed)))

    @cached_property
    def is_gaussian(self) -> Bool[np.ndarray, " alternatives"]:
        """Which of them have no tails."""
        return np.array([model.tail is None for model in self.listed], bool)

    @cached_property
    def is_level(self) -> Bool[np.ndarray, " alternatives"]:
        """Which of them leave the level of the noise open."""
        return np.array([model.kind == LEVEL for model in self.listed], bool)

    @cached_property
    def log_weights(self) -> Float[np.ndarray, " alternatives"]:
        """Logarithms of the prior weights."""
        return np.array([model.log_weight for model in self.listed])

    @cached_property
    def by_kind(self) -> tuple[Int[np.ndarray, " alternatives"], Int[np.ndarray, " kinds"]]:
        """The alternatives of each label and kind together, and where each kind begins."""
        kinds = [(model.label, model.kind) for model in self.listed]
        own = np.array([kinds.index(kind) for kind in kinds], int)
        order = np.argsort(own, kind="stable")
        return order, np.unique(own[order], return_index=True)[1]

    def without(self, labels: tuple[str, ...]) -> "NoiseAlternatives":
        """The alternatives with other labels than these."""
        if not labels:
            return self
        return NoiseAlternatives(self.at, tuple(model for model in self.listed if model.label not in labels))

    @cached_property
    def whitening(self) -> Whitening:
        """The covariances of those without tails."""
        gaussian = [model for model in self.listed if model.tail is None]
        covariances, of_means = [model.covariance for model in gaussian], [model.of_means for model in gaussian]
        return Whitening(self.at, covariances, self.repeats, of_means)

    @cached_property
    def repeats(self) -> Repeats:
        """Which positions repeat an attitude."""
        return Repeats.of(self.at)

    def log_evidence(
        self,
        z: Float[np.ndarray, "draws nu"],
        known: bool,
        squares: Float[np.ndarray, "covariances draws"] | None = None,
    ) -> Float[np.ndarray, "draws alternatives"]:
        """Log evidence with prior weight, on the scale of `evidence.log_evidence`; `squares`: sums of squares of the vectors
        under each covariance, where they are already there."""
        evidence, dof, gaussian = np.zeros((len(self.listed), len(z))), z.shape[1], self.is_gaussian
        if np.any(gaussian):
            squares = self.whitening.squares(z.T) if squares is None else squares
            evidence[gaussian] = log_evidence_of_noise(squares, dof, known) - self.whitening.half_log_dets[:, None]
        evidence[self.is_level] = log_evidence_of_noise(np.vecdot(z, z), dof, known=False)
        for number in np.flatnonzero(~gaussian).tolist():
            evidence[number] = self._with_tail(z, self.listed[number], known)
        return (evidence + self.log_weights[:, None]).T

    def _with_tail(
        self, z: Float[np.ndarray, "draws nu"], model: NoiseModel, known: bool
    ) -> Float[np.ndarray, " draws"]:
        """Log evidence of Student's t against the normal: of the readings' residuals, each with its own best scale (profile
        likelihood), or of means over repeats whose differences show the scale.

        The residuals have fewer dimensions than rows: each is counted in its own standard deviation and for its share of the
        dimensions (one minus its leverage), or unequal leverages would look like heavy tails.
        """
        rows, dof, total, tail = self.at.basis[: self.at.problem.readings.size], z.shape[1], np.vecdot(z, z), model.tail
        assert tail is not None
        variance = np.ones(len(z)) if known else total / dof
        of_differences, scale = np.zeros(len(z)), variance
        if model.of_means:
            turned, mean = self.repeats.turned(rows), np.repeat(self.repeats.is_mean, 3)
            rows, differences, free = turned[mean], z @ turned[~mean].T, float(np.sum(turned[~mean] ** 2))
            shown = np.vecdot(differences, differences)
            scale = variance if known else np.maximum(shown / free, 1e-12 * variance)
            of_differences = -0.5 * (free * np.log(scale / variance) + shown * (1.0 / scale - 1.0 / variance))
        share = np.vecdot(rows, rows)
        rows, share = rows[share > _LEAST_SHARE], share[share > _LEAST_SHARE]
        squares = (z @ rows.T) ** 2 / share
        spread = variance
        if not (known or model.of_means):
            # The squared scale of the highest likelihood of Student's t, by reweighting (Lange, Little and Taylor 1989).
            spread, scale = squares @ share / np.sum(share), 0.5 * variance
            for _ in range(_STEPS):
                scale = ((tail + 1) / (tail + squares / scale[:, None]) * squares) @ share / np.sum(share)
            scale = np.maximum(scale, 1e-12 * np.maximum(variance, 1e-300))
        # Log densities of Student's t with these degrees of freedom and squared scales, and of the normal distribution.
        constant = gammaln((tail + 1) / 2) - gammaln(tail / 2) - 0.5 * np.log(tail * np.pi * scale)
        log_t = constant[:, None] - 0.5 * (tail + 1) * np.log1p(squares / (scale * tail)[:, None])
        log_normal = -0.5 * (np.log(2 * np.pi * spread)[:, None] + squares / spread[:, None])
        return log_evidence_of_noise(total, dof, known) + of_differences + (log_t - log_normal) @ share
