"""Rounded readings: the contribution of rounding to a stated noise.

A reading rounded to steps of q has an error that is uniform over q, of variance q^2/12 (Widrow and Kollar 2008). If the stated
noise is smaller than the steps, it does not include the rounding, and each rounded reading looks like a cause.
"""

import numpy as np
from jaxtyping import Float

from tumblecal.estimation.problem import Problem
from tumblecal.ground.axes import AXES
from tumblecal.noise.covariance import Covariance


# Steps (g) that are looked for, the widest first: 1, 2 and 5 times a power of ten.
_STEPS_G = np.array([factor * 10.0**power for power in range(-2, -8, -1) for factor in (5, 2, 1)])
# A reading is a multiple of a step to within this share of it.
_WHOLE = 1e-3


def steps(readings: Float[np.ndarray, "positions 3"]) -> Float[np.ndarray, " 3"]:
    """The widest decimal step (g) of which all readings of each axis are multiples; 0 if there is none."""
    multiples = readings[None] / _STEPS_G[:, None, None]
    whole = np.all(np.abs(multiples - np.round(multiples)) < _WHOLE, axis=1)
    return np.where(np.any(whole, axis=0), _STEPS_G[np.argmax(whole, axis=0)], 0.0)


def with_rounding(problem: Problem) -> tuple[Problem, dict[str, str]]:
    """A problem of independent readings with stated noise plus the rounding noise, and its description by catalogue id; no
    entry if rounding is negligible."""
    step = steps(np.asarray(problem.readings))
    rounding = step / np.sqrt(12.0)
    usual = np.median(problem.sd, axis=0)
    # If it is smaller than the stated noise, that may include it.
    described = {
        f"quantisation.{AXES[axis]}": (
            f"the readings of {AXES[axis]} are rounded to steps of {step[axis] * 1e3:g} mg: rounding has a "
            f"standard deviation of {rounding[axis] * 1e3:.2g} mg, the stated noise {usual[axis] * 1e3:.2g} mg"
        )
        for axis in np.flatnonzero(rounding > usual).tolist()
    }
    if not described:
        return problem, {}
    return problem.with_noise(Covariance.of_sd(np.hypot(problem.sd, rounding)), known=True), described
