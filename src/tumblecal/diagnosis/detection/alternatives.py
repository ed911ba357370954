"""Alternatives to causes with coefficients: a different noise, and lack of fit that no catalogued effect describes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import UNEXPLAINED, Cause
from tumblecal.diagnosis.causes.table import Blocks
from tumblecal.diagnosis.lack_of_fit.lack_of_fit import LackOfFit
from tumblecal.diagnosis.noise.alternatives import NoiseAlternatives
from tumblecal.diagnosis.priors import ALTERNATIVES_SHARE
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


@dataclass(frozen=True)
class Alternatives:
    """The covariances that compete with sets of causes, for one residual vector and others of its plan.

    - `z`: the residual vector; `known`: whether its noise is.
    """

    __repr__ = brief

    noise: NoiseAlternatives
    lack: LackOfFit
    z: Float[np.ndarray, " nu"]
    known: bool

    def test_log_evidence(
        self, z: Float[np.ndarray, "draws nu"], known: bool
    ) -> Float[np.ndarray, "draws alternatives"]:
        """Log evidence of each for many residual vectors with its weight in the test, on the scale of
        `evidence.log_evidence`: the noise, then the lack of fit."""
        own = len(z) == 1 and known == self.known and np.array_equal(z[0], self.z)
        noise = self._noise_evidence[None] if own else self.noise.log_evidence(z, known)
        lack = self._lack_by_size if own else self.lack.by_size(z, known)
        return np.hstack([noise + np.log(ALTERNATIVES_SHARE), self.lack.test_log_evidence(lack)])

    @property
    def test_log_weights(self) -> Float[np.ndarray, " alternatives"]:
        """Logarithms of the weights in the test, in the order of `test_log_evidence`."""
        return np.concatenate([self.noise.log_weights + np.log(ALTERNATIVES_SHARE), self.lack.test_log_weights])

    @cached_property
    def by_label(self) -> dict[str, float]:
        """Log evidence of each label, with its prior weight."""
        values = self._noise_evidence
        labels = np.array([model.label for model in self.noise.listed], object)
        by_label = {label: float(np.logaddexp.reduce(values[labels == label])) for label in dict.fromkeys(labels)}
        unexplained = np.logaddexp(by_label.get(UNEXPLAINED, -np.inf), self.lack_of_fit)
        return by_label | ({UNEXPLAINED: float(unexplained)} if np.isfinite(unexplained) else {})

    @cached_property
    def lack_of_fit(self) -> float:
        """Log evidence of lack of fit, without that from repeats, including its prior weight."""
        return self.lack.log_evidence(self._lack_by_size, self.z, self.known)

    @cached_property
    def unexplained(self) -> Cause | str:
        """The most probable error without a catalogue entry: as a cause to be fitted, or in words for an error shown by
        repeats."""
        shown = [
            (value, model.words)
            for value, model in zip(self._noise_evidence, self.noise.listed, strict=True)
            if model.label == UNEXPLAINED
        ]
        value, words = max(shown, default=(-np.inf, ""))
        return words if value > self.lack_of_fit else self.lack.cause(self._lack_by_size, self.z, self.known)

    @cached_property
    def _noise_evidence(self) -> Float[np.ndarray, " noises"]:
        return self.noise.log_evidence(self.z[None], self.known)[0]

    @cached_property
    def _lack_by_size(self) -> Float[np.ndarray, "processes sizes 1"]:
        return self.lack.by_size(self.z[None], self.known)


def alternatives(at: Tangent, effects: Blocks) -> Alternatives:
    """Alternatives for one problem, given effects with these blocks."""
    return Alternatives(NoiseAlternatives.of(at), LackOfFit.of(at, effects), at.z, at.problem.known)
