"""What may be wrong beside causes with coefficients: another noise, and lack of fit that no entry describes."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.generic_causes import UNEXPLAINED
from tumblecal.diagnosis.lack_of_fit import LackOfFit, lack_of_fit
from tumblecal.diagnosis.noise_causes import NoiseAlternative, log_noise_evidence, noise_alternatives
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.ground.showing import brief


@dataclass(frozen=True)
class Alternatives:
    """The covariances that are weighed beside sets of causes."""

    __repr__ = brief

    noise: list[NoiseAlternative]
    lack: LackOfFit

    def log_evidence(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "draws alternatives"]:
        """Log evidence of each with its prior weight, on the scale of `evidence.log_evidence`: the noise, then the lack of
        fit."""
        return np.hstack([log_noise_evidence(self.noise, z, known), self.lack.log_evidence(z, known)])

    @property
    def labels(self) -> tuple[str, ...]:
        """The label of each."""
        return (*(tried.label for tried in self.noise), *(UNEXPLAINED for _ in self.lack.words))

    def by_label(self, z: Float[np.ndarray, " nu"], known: bool) -> dict[str, float]:
        """Log evidence of each label."""
        values, labels = self.log_evidence(z[None], known)[0], np.array(self.labels, object)
        return {label: float(np.logaddexp.reduce(values[labels == label])) for label in dict.fromkeys(self.labels)}

    def unexplained(self, z: Float[np.ndarray, " nu"], known: bool) -> Cause | str:
        """The most probable one that no entry describes: as a cause to be fitted, or in words what repeats show."""
        values = np.where(np.array(self.labels) == UNEXPLAINED, self.log_evidence(z[None], known)[0], -np.inf)
        best = int(np.argmax(values))
        return self.noise[best].words if best < len(self.noise) else self.lack.cause(z, known)


def alternatives(at: Tangent) -> Alternatives:
    """Those of one problem."""
    return Alternatives(noise_alternatives(at), lack_of_fit(at))
