"""Nominal parameters beside a set of effects by one linear step: enough for explanations that are hardly probable."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.exact.insert import directions_of
from tumblecal.diagnosis.findings.common_size import prior_rows, updated_by
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.estimation.identifiability import RANK_TOLERANCE


class LinearEstimate(NamedTuple):
    """Nominal parameters (base units) and their covariance."""

    values: Float[np.ndarray, " nominal"]
    covariance: Float[np.ndarray, "nominal nominal"]


def linear_estimate(
    at: Tangent, causes: Sequence[Cause], added: Float[np.ndarray, "nominal full"]
) -> LinearEstimate | None:
    """The estimate at the reference; None beside causes that are no effects of the catalogue.

    **Arguments:**

    - `added`: what the coefficients add to the nominal parameters, as of `findings.reference.moved_to_reference`.
    """
    if not all(cause.slot.columns for cause in causes):
        return None
    nominal, free = at.model.nominal, directions_of(at, causes)
    inverse = np.linalg.pinv(at.jacobian @ free, rcond=RANK_TOLERANCE)
    step = inverse @ at.residual
    left = at.residual - at.jacobian @ (free @ step)
    sigma = 1.0 if at.problem.known else float(np.sqrt(left @ left / max(1, len(left) - len(step))))
    covariance = sigma**2 * inverse @ inverse.T
    prior = prior_rows(causes, free, free @ step, free @ covariance @ free.T) @ free
    step, covariance = updated_by(prior, step, covariance)
    to = at.model.scales[:nominal, None] * (free[:nominal] + added @ free)
    return LinearEstimate(at.vector[:nominal] + to @ step, to @ covariance @ to.T)
