"""A recording as a linear observation of the nine sensor parameters: all unknown angles are eliminated.

White rows of the readings, and of priors on angles, are linear in the parameters near a vector: `e = H (p - m) + noise`, with
the covariance 1. Columns of unknown angles (tilts, mount, pitch errors) are eliminated by projection on their orthogonal
complement, which is the least-squares estimate of these angles with their priors. A position of unknown attitude leaves one
row: the size of gravity. With known angles three rows remain for each position, less the number of unknown angles.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.estimation.linearised import linearised
from tumblecal.estimation.problem import Problem
from tumblecal.ground.errors import InputError


_ROUNDS = 30
# A Gauss-Newton step that changes no white row by more than this is the last.
_SMALL = 1e-6
# A direction of unknown angles with a smaller relative singular value has no influence.
_RANK = 1e-9


@dataclass(frozen=True)
class Observation:
    """Rows with covariance 1.

    - `innovation` (rows): e, measured minus predicted at the parameters m. `slopes` (rows, 9): H by the parameters in the order
      of `SENSOR`, base units.
    - `of_attitude` (positions, rows, 3): derivative of e by the reading of each position, 1/g. `names`: of the positions.
    - `responses` (positions, terms, 3): derivative of the readings by the coefficients of the terms of the calibration.
    """

    innovation: Float[np.ndarray, " rows"]
    slopes: Float[np.ndarray, "rows 9"]
    of_attitude: Float[np.ndarray, "positions rows 3"]
    names: tuple[str, ...]
    responses: Float[np.ndarray, "positions terms 3"]

    def by_state(self, slope: Float[np.ndarray, "9 state"]) -> Float[np.ndarray, "rows state"]:
        """Derivative of e by a state whose last entries are the coefficients of the terms, if there are any.

        **Arguments:**

        - `slope`: derivative of the parameters by the state.
        """
        rows, terms = self.slopes @ slope, self.responses.shape[1]
        if terms:
            rows[:, -terms:] += np.einsum("pri,pti->rt", self.of_attitude, self.responses)
        return rows

    def without(self, name: str) -> "Observation":
        """The observation without one position: its readings may have any value."""
        number = self.names.index(name)
        rest = _complement(self.of_attitude[number])
        others = [k for k in range(len(self.names)) if k != number]
        return Observation(
            rest.T @ self.innovation,
            rest.T @ self.slopes,
            rest.T @ self.of_attitude[others],
            tuple(self.names[k] for k in others),
            self.responses[others],
        )

    def scaled(self, factor: float) -> "Observation":
        """The observation for standard deviations that are larger by a factor."""
        return replace(
            self,
            innovation=self.innovation / factor,
            slopes=self.slopes / factor,
            of_attitude=self.of_attitude / factor,
        )


def observed(
    problem: Problem,
    mean: Float[np.ndarray, "9"],
    near: Float[np.ndarray, "9"] | None = None,
    responses: Float[np.ndarray, "positions terms 3"] | None = None,
) -> Observation:
    """The observation of a problem whose chain has the sensor's parameters without priors.

    **Arguments:**

    - `mean`: the parameters m. `near`: the parameters at which it is linearised; `mean` if omitted. `responses`: as of
      `Observation`; none if omitted.

    **Raises:** `InputError` if no angles explain the readings.
    """
    names = problem.chain.names
    sensor = [names.index(name) for name in SENSOR]
    angles = [number for number in range(len(names)) if number not in sensor]
    near = mean if near is None else near
    vector = problem.chain.vector.copy()
    vector[sensor] = near
    for _ in range(_ROUNDS):
        residual, jacobian = (np.asarray(part) for part in linearised(problem, vector))
        step = np.linalg.lstsq(jacobian[:, angles], residual, rcond=_RANK)[0] if angles else np.zeros(0)
        vector[angles] -= step * problem.scales[angles]
        if np.max(np.abs(jacobian[:, angles] @ step), initial=0.0) < _SMALL:
            break
    else:
        raise InputError(
            f"{problem.source}: no attitudes explain these readings; check the angles, or omit them (--static)"
        )
    slopes = jacobian[:, sensor] / np.asarray(problem.scales)[sensor]
    complement = _complement(jacobian[:, angles])
    count = len(problem.readings)
    by_reading = np.zeros((len(residual), 3 * count))
    by_reading[: 3 * count] = problem.rows(np.eye(3 * count).reshape(count, 3, 3 * count))
    by_attitude = (complement.T @ by_reading).reshape(-1, count, 3).swapaxes(0, 1)
    rows = complement.T @ slopes
    innovation = -complement.T @ residual + rows @ (near - mean)
    responses = np.zeros((count, 0, 3)) if responses is None else responses
    return Observation(innovation, rows, by_attitude, problem.names, responses)


def _complement(columns: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows rest"]:
    """An orthonormal basis of the directions that no column reaches."""
    left, sizes, _ = np.linalg.svd(columns)
    rank = int(np.sum(sizes > _RANK * sizes[0])) if len(sizes) else 0
    return left[:, rank:]
