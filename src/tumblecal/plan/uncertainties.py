"""The uncertainties that a schedule gives: of the shared parameters, and of the corrected force in use."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.noise.of_head import slow_covariance
from tumblecal.plan.linear_model import LinearModel, scheduled_model
from tumblecal.plan.responses import Responses
from tumblecal.plan.schedule import Schedule


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
    def determined(self) -> tuple[str, ...]:
        """Parameters that are determined."""
        return tuple(name for name, sd in zip(self.names, self.sd, strict=True) if not np.isinf(sd))

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters that are not determined."""
        return tuple(name for name, sd in zip(self.names, self.sd, strict=True) if np.isinf(sd))


def uncertainties(responses: Responses, schedule: Schedule, ability: HeadAbility) -> Uncertainties:
    """The standard uncertainties that an exact fit of a schedule states, settings set again and slow noise included."""
    model, information = scheduled_information(responses, schedule, ability)
    covariance = model.shared(information)
    lost = np.isin(model.names, model.unbounded(covariance))
    sd = np.where(lost, np.inf, np.sqrt(np.diag(covariance)) * responses.scales)
    return Uncertainties(responses.names, responses.scales, sd, covariance)


def scheduled_information(
    responses: Responses, schedule: Schedule, ability: HeadAbility
) -> tuple[LinearModel, Float[np.ndarray, "all all"]]:
    """The model of a schedule, and the information after it under white and slow noise."""
    slow = slow_covariance(ability.slow_noise, ability.times, schedule.start_s)[0]
    model = scheduled_model(responses, schedule)
    return model, information_of(model, slow / responses.sd**2)


def information_of(
    model: LinearModel, slow: Float[np.ndarray, "*n positions positions"] | None = None
) -> Float[np.ndarray, "*n all all"]:
    """Information after all positions of a model, or of each of several lists of positions.

    **Arguments:** `slow`: covariance of the means on each axis in addition to white noise of one; omitted: none.
    """
    rows = weighted = model.columns
    *lead, count, _, parameters = rows.shape
    if slow is not None:
        weighted = np.linalg.solve(slow + np.eye(count), rows.reshape(*lead, count, -1)).reshape(rows.shape)
    flat, weighted = (each.reshape(*lead, 3 * count, parameters) for each in (rows, weighted))
    return model.information + flat.swapaxes(-1, -2) @ weighted


def in_use_sd(use: Responses, covariance: Float[np.ndarray, "shared shared"]) -> Float[np.ndarray, "attitudes 3"]:
    """Standard uncertainty of the corrected force on each axis, g.

    **Arguments:**

    - `use`: responses of the attitudes in which the sensor is used. `covariance`: of the scaled shared parameters.
    """
    return np.sqrt(np.vecdot(use.columns @ covariance, use.columns))
