"""The uncertainties that a schedule gives: of the shared parameters, and of the corrected force in use."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.design.model.information import design_of, information_of, noise_covariance
from tumblecal.design.model.responses import Responses
from tumblecal.design.model.schedule import Schedule


# Directions with less information than this share of the largest, all parameters in their own uncertainty, are not determined.
DETERMINED = 1e-9
# A parameter with more than this share in such a direction is not determined.
_SHARE = 1e-4
_ROUNDING = 1e-12
# Nor is one with a larger standard uncertainty, in its scale: 1 rad, 1 g, 100 %.
_MEANINGLESS = 1e3


@dataclass(frozen=True)
class Uncertainties:
    """Of the shared parameters of a schedule.

    - `names`, `scales`, `sd`: standard uncertainties, base units (rad, g, 1); infinite for a parameter that is not determined.
    - `covariance`: of the scaled parameters; of those that are not determined it has no meaning.
    """

    names: tuple[str, ...]
    scales: Float[np.ndarray, " shared"]
    sd: Float[np.ndarray, " shared"]
    covariance: Float[np.ndarray, "shared shared"]

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters that are not determined."""
        return tuple(name for name, sd in zip(self.names, self.sd, strict=True) if np.isinf(sd))


def uncertainties(responses: Responses, schedule: Schedule, ability: HeadAbility) -> Uncertainties:
    """The standard uncertainties that an exact fit of a schedule states, settings set again and slow noise included."""
    design, count = design_of(responses, schedule), len(responses.names)
    information = information_of(design, noise_covariance(responses, schedule, ability))
    mixed = information[:count, count:]
    of_visits = np.linalg.pinv(information[count:, count:], hermitian=True)
    reduced = information[:count, :count] - mixed @ of_visits @ mixed.T
    # Rounding of the difference is relative to what is subtracted.
    size = np.sqrt(np.diag(information)[:count])
    # A response of rounding size, cos 90 deg, is none; scaled up it would be confounded with another.
    size = np.maximum(size, max(_ROUNDING * np.max(size), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(reduced / np.outer(size, size))
    lost = values < DETERMINED
    share = np.sum(vectors[:, lost] ** 2, axis=1)
    inverse = vectors[:, ~lost] / values[~lost] @ vectors[:, ~lost].T
    covariance = inverse / np.outer(size, size)
    scaled = np.sqrt(np.diag(covariance))
    sd = np.where((share > _SHARE**2) | (scaled > _MEANINGLESS), np.inf, scaled * responses.scales)
    return Uncertainties(responses.names, responses.scales, sd, covariance)


def in_use_sd(use: Responses, covariance: Float[np.ndarray, "shared shared"]) -> Float[np.ndarray, "attitudes 3"]:
    """Standard uncertainty of the corrected force on each axis, g.

    **Arguments:**

    - `use`: responses of the attitudes in which the sensor is used. `covariance`: of the scaled shared parameters.
    """
    return np.sqrt(np.einsum("cai,ij,caj->ca", use.columns, covariance, use.columns))
