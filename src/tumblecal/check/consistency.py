"""Test whether a recording agrees with a calibration: chi-square of the innovation, with its power.

The innovation `e = H (p - m) + noise` has the covariance `1 + H P H'` if the calibration is still valid. Its part in the
directions that the parameters reach decides: T^2 has as many degrees of freedom as there are visible directions. The rest does
not depend on the parameters: it tests whether the attitudes agree with each other. If they do not, and no single attitude
explains it, the noise is estimated from the rest, if it has five degrees of freedom.

Estimated noise has a factor with the distribution of chi-square over its degrees of freedom, both that of the calibration and
that of the recording; the p-value is that of `few_dof.no_change`.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.special import chndtr, fdtrc, gammaincc, gammainccinv, ncfdtr

from tumblecal.check.expected import Expected
from tumblecal.check.observation import Observation
from tumblecal.check.usual_changes import USUAL
from tumblecal.history.few_dof import joint_dof, no_change


# Level of the test: false alarms in 0.5 % of the checks.
LEVEL = 0.005
# Tail probability below which the rest contradicts the noise.
UNLIKELY = 0.001
# A direction is visible if ten times the usual change along it is at least one standard deviation of the noise.
_LEAST_SEEN = 0.1
_MANY = 1e6
_LARGE = 500.0
# With fewer degrees of freedom an estimated noise would be less certain than a stated one.
_LEAST_DOF = 5


@dataclass(frozen=True)
class Consistency:
    """The test of a recording.

    - `observation`: its rows, with the noise that the rest of the rows supports. `expected`: the calibration.
    - `basis` (rows, k): orthonormal basis of the visible directions of the rows. `hidden` (9, 9 - k): changes of the parameters
      that no row shows, as multiples of their usual sizes.
    - `chi2`, `dof`, `p_value`: T^2 of the parameters. `rest_chi2`, `rest_dof`, `rest_p`: of the rest, with the noise as stated;
      `rest_p` is None without a degree of freedom. `noise_factor`: of the standard deviations, 1 unless the rest contradicts.
    - `noise_dof`: degrees of freedom of the noise of the recording. `shared`: whether it is the noise of the calibration, with
      the same unknown factor.
    """

    observation: Observation
    expected: Expected
    basis: Float[np.ndarray, "rows k"]
    hidden: Float[np.ndarray, "9 hidden"]
    rest_chi2: float
    rest_dof: int
    rest_p: float | None
    noise_factor: float
    noise_dof: float
    shared: bool

    @property
    def rejected(self) -> bool:
        """Whether the calibration is rejected."""
        return self.p_value < LEVEL

    @property
    def disagree(self) -> bool:
        """Whether the attitudes disagree with each other beyond the stated noise, for any parameters."""
        return self.rest_p is not None and self.rest_p < UNLIKELY

    @property
    def dof(self) -> int:
        """Number of visible directions."""
        return self.basis.shape[1]

    @cached_property
    def slopes(self) -> Float[np.ndarray, "k 9"]:
        """Derivative of the visible part of the innovation by the parameters."""
        return self.basis.T @ self.observation.slopes

    @cached_property
    def covariance(self) -> Float[np.ndarray, "k k"]:
        """Covariance of the visible part of the innovation without a change."""
        return np.eye(self.dof) + self._of_calibration + self._of_common

    @cached_property
    def _of_calibration(self) -> Float[np.ndarray, "k k"]:
        """Covariance of the visible part by the uncertainty of the calibration."""
        by_state = self.basis.T @ self.observation.by_state(self.expected.slope)
        return by_state @ self.expected.covariance @ by_state.T

    @property
    def _of_common(self) -> Float[np.ndarray, "k k"]:
        return self.slopes @ self.expected.common @ self.slopes.T

    @property
    def chi2(self) -> float:
        """T^2."""
        along = self.basis.T @ self.observation.innovation
        return float(along @ np.linalg.solve(self.covariance, along)) if self.dof else 0.0

    @cached_property
    def p_value(self) -> float:
        """Probability of a T^2 at least this large without a change."""
        return self.tail(self.basis.T @ self.observation.innovation)

    def tail(self, along: Float[np.ndarray, " k"]) -> float:
        """The p-value of a visible part of an innovation."""
        if not self.dof:
            return 1.0
        parts, dofs = self._parts
        return no_change(along, parts, dofs)[2] or 0.0

    @cached_property
    def _parts(self) -> tuple[list[np.ndarray], list[float]]:
        """Covariances with separate unknown factors, and their degrees of freedom."""
        slopes, sensor = self.slopes, self.expected.sensor
        if not self.shared:
            return [self._of_calibration, np.eye(self.dof) + self._of_common], [
                joint_dof(sensor, slopes),
                self.noise_dof,
            ]
        noise = self._of_calibration if sensor.noise is None else slopes @ sensor.noise @ slopes.T
        rest = self._of_calibration - noise + self._of_common
        return [noise + np.eye(self.dof), rest], [self.noise_dof, np.inf]

    def per_unit(self, change: Float[np.ndarray, "9"]) -> float:
        """Noncentrality of T^2 for a change of the parameters."""
        along = self.slopes @ change
        return float(along @ np.linalg.solve(self.covariance, along)) if self.dof else 0.0

    def power(self, change: Float[np.ndarray, "9"], times: float | np.ndarray = 1.0) -> float:
        """Probability of detecting a change of the parameters, multiplied by `times`."""
        if not self.dof:
            return 0.0
        return float(_power(self.dof, self._dof_towards(change), self.per_unit(change) * np.square(times)))

    def detectable(self, change: Float[np.ndarray, "9"], probability: float = 0.8) -> float:
        """The multiple of a change that is detected with a probability; infinite for an invisible one."""
        unit = self.per_unit(change)
        if not unit > 0:
            return np.inf
        dof, low, high = self._dof_towards(change), 0.0, 1.0
        while _power(self.dof, dof, high) < probability:
            low, high = high, 2 * high
        for _ in range(50):
            middle = (low + high) / 2
            low, high = (middle, high) if _power(self.dof, dof, middle) < probability else (low, middle)
        return float(np.sqrt(high / unit))

    def _dof_towards(self, change: Float[np.ndarray, "9"]) -> float:
        """Degrees of freedom of the F distribution with the critical value of the test along a change."""
        _, dofs = self._parts
        if not np.any(np.isfinite(dofs)):
            return np.inf
        along = self.slopes @ change
        size = np.sqrt(along @ np.linalg.solve(self.covariance, along))
        if not size > 0:
            return float(min(dofs))
        low, high = 0.0, 1.0
        while self.tail(along * high / size) > LEVEL:
            low, high = high, 2 * high
        for _ in range(30):
            middle = (low + high) / 2
            low, high = (middle, high) if self.tail(along * middle / size) > LEVEL else (low, middle)
        return _dof_of_critical(self.dof, high**2)


def tested(
    observation: Observation,
    expected: Expected,
    *,
    noise_dof: float = np.inf,
    shared: bool = False,
    estimate: bool = False,
) -> Consistency:
    """Test a recording.

    **Arguments:**

    - `noise_dof`, `shared`: as of `Consistency`. `estimate`: whether the noise is estimated from the rest if it contradicts.
    """
    left, sizes, right = np.linalg.svd(observation.slopes * USUAL)
    seen = int(np.sum(sizes >= _LEAST_SEEN))
    rest = left[:, seen:].T @ observation.innovation
    chi2, dof = float(rest @ rest), len(rest)
    tail = None if not dof else _tail(chi2, dof, noise_dof)
    factor = 1.0
    if estimate and tail is not None and tail < UNLIKELY and dof >= _LEAST_DOF:
        factor, noise_dof, shared = float(np.sqrt(chi2 / dof)), float(dof), False
    return Consistency(
        observation.scaled(factor),
        expected,
        left[:, :seen],
        right[seen:].T,
        chi2,
        dof,
        tail,
        factor,
        noise_dof,
        shared,
    )


def _tail(chi2: float, dof: int, noise_dof: float) -> float:
    if np.isinf(noise_dof):
        return float(gammaincc(dof / 2, chi2 / 2))
    return float(fdtrc(dof, min(noise_dof, _MANY), chi2 / dof))


def _critical(count: int, dof: float) -> float:
    """The critical value of T^2 of `count` directions at `LEVEL`."""
    if dof >= _MANY:
        return float(2 * gammainccinv(count / 2, LEVEL))
    from scipy.special import fdtri

    return float(count * fdtri(count, dof, 1 - LEVEL))


def _power(count: int, dof: float, noncentrality: float | np.ndarray) -> np.ndarray:
    critical = _critical(count, dof)
    # Far above the critical value the power is 1, and the series of the noncentral distributions fail.
    within = np.minimum(noncentrality, _LARGE + 4 * critical)
    if dof >= _MANY:
        return 1 - chndtr(critical, count, within)
    return 1 - ncfdtr(count, dof, within, critical / count)


def _dof_of_critical(count: int, critical: float) -> float:
    """The degrees of freedom whose F distribution has this critical value; infinite if chi-square has it."""
    if critical <= _critical(count, np.inf) * (1 + 1e-6):
        return np.inf
    low, high = 0.0, np.log(_MANY)
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if _critical(count, float(np.exp(middle))) > critical else (low, middle)
    return float(np.exp(high))
