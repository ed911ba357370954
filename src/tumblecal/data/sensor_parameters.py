"""Scale factors, biases, non-orthogonalities and mount angles of a calibration, with their covariance.

`A = diag(1 + dK) T f + bias`, T = [1 0 0; gamma_21 1 0; gamma_31 gamma_32 1], f in the frame of the triad.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Inexact

from tumblecal.data.coverage_factor import effective_dof
from tumblecal.ground.axes import AXES
from tumblecal.ground.showing import brief
from tumblecal.ground.units import in_words, shown


SENSOR = (*(f"{name}_{axis}" for name in ("dK", "bias") for axis in AXES), "gamma_21", "gamma_31", "gamma_32")
MOUNT = tuple(f"dtheta_{axis}" for axis in AXES)
# Words for the parameters of a leaf, and their unit.
GROUPS = {"dK": ("scale factors", "1"), "bias": ("biases", "g"), "gamma": ("non-orthogonality", "rad")}
GROUPS |= {"dtheta": ("mount", "rad")}
# Units of the parameters of the sensor and of their leaves.
UNITS = {name: GROUPS[name.partition("_")[0]][1] for name in ("dK", "bias", "gamma", *SENSOR)}
# Central differences: exact to about 1e-10 of the derivative.
_STEP = 1e-6


@dataclass(frozen=True)
class SensorParameters:
    """Values in base units (1, g, rad) by name; a covariance of zeros means that none was stated.

    - `undetermined`: names of parameters that the data cannot separate from an effect, whose assumed size gives their
      standard uncertainty.
    - `dof`: degrees of freedom of the noise variance, infinite for stated noise. If finite, `covariance` has an unknown factor
      with the distribution of chi-square of `dof` divided by `dof`.
    - `noise`: the part of `covariance` with this factor; the rest is due to inputs of a budget or hysteresis. None: all of it.
    """

    __repr__ = brief

    names: tuple[str, ...]
    values: Float[np.ndarray, " names"]
    covariance: Float[np.ndarray, "names names"]
    undetermined: tuple[str, ...] = ()
    dof: float = math.inf
    noise: Float[np.ndarray, "names names"] | None = None

    def places(self, names: Sequence[str]) -> list[int]:
        """Indices of parameters."""
        return [self.names.index(name) for name in names]

    def of(self, names: Sequence[str]) -> "SensorParameters":
        """A subset of the parameters."""
        places = self.places(names)
        undetermined = tuple([name for name in self.undetermined if name in names])
        block = np.ix_(places, places)
        noise = None if self.noise is None else self.noise[block]
        return SensorParameters(
            tuple(names), self.values[places], self.covariance[block], undetermined, self.dof, noise
        )

    @property
    def undetermined_words(self) -> str:
        """Undetermined parameters with their assumed standard uncertainty; "" if all are determined."""
        units = (shown(GROUPS[leaf_of(name)][1]) for name in self.undetermined)
        sizes = zip(self.undetermined, self.sd[self.places(self.undetermined)].tolist(), units, strict=True)
        return ", ".join([f"{name} (sd {in_words(f'{sd * scale:.2g}', unit)})" for name, sd, (unit, scale) in sizes])

    @property
    def sd(self) -> Float[np.ndarray, " names"]:
        """Standard uncertainties; 0 if not stated."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def sizes(self) -> Float[np.ndarray, "2 names"]:
        """Standard uncertainties by the noise with `dof`, and by all other contributions."""
        variance = np.diag(self.covariance)
        of_noise = variance if self.noise is None else np.diag(self.noise)
        return np.sqrt(np.stack([of_noise, np.maximum(variance - of_noise, 0.0)]))

    @property
    def effective_dof(self) -> Float[np.ndarray, " names"]:
        """Degrees of freedom of each variance by Welch and Satterthwaite (JCGM 100, G.4), with infinitely many for inputs of a
        budget and hysteresis; infinite for stated noise or no noise."""
        return effective_dof(self.sizes, np.array([self.dof, np.inf]))


def leaf_of(name: str) -> str:
    """The leaf of a parameter: `dK` of `dK_x`; `dK_T` of its change with temperature, `dK_T_x1`."""
    leaf, _, component = name.partition("_")
    return f"{leaf}_T" if component.startswith("T_") else leaf


def of_matrix(
    matrix: Float[np.ndarray, "3 3"], bias: Float[np.ndarray, "3"], covariance: Float[np.ndarray, "12 12"]
) -> SensorParameters:
    """The sensor parameters of a correction `f = matrix (A - bias)` in any frame; `covariance` is of the rows of the matrix
    and the bias. A rotation of the frame does not change them."""

    def parameters(flat: np.ndarray) -> np.ndarray:
        lower = lower_triangle(np.linalg.inv(flat[:9].reshape(3, 3)))
        scales = np.diag(lower)
        return np.concatenate([scales - 1, flat[9:], (lower / scales[:, None])[[1, 2, 2], [0, 0, 1]]])

    flat = np.concatenate([np.ravel(matrix), bias])
    slope = derivative(parameters, flat)
    return SensorParameters(SENSOR, parameters(flat), slope @ covariance @ slope.T)


def triad_of(values: Inexact[np.ndarray, "*several 9"]) -> Inexact[np.ndarray, "*several 3 3"]:
    """`diag(1 + dK) T` of numbers in the order of `SENSOR`; also complex, for derivatives by complex steps."""
    triad = np.zeros((*values.shape[:-1], 3, 3), values.dtype)
    triad[..., range(3), range(3)] = 1.0
    triad[..., [1, 2, 2], [0, 0, 1]] = values[..., 6:]
    return (1 + values[..., :3, None]) * triad


def correction_slope(values: Float[np.ndarray, "9"]) -> Float[np.ndarray, "12 9"]:
    """Derivative of matrix (rows) and bias of a correction by the sensor parameters, in the order of `SENSOR`."""

    def correction(several: np.ndarray) -> np.ndarray:
        return np.concatenate([np.linalg.inv(triad_of(several)).reshape(-1, 9), several[:, 3:6]], axis=1)

    return exact_derivative(correction, values)


def exact_derivative(
    function: Callable[[np.ndarray], np.ndarray], values: Float[np.ndarray, " values"]
) -> Float[np.ndarray, "results values"]:
    """Jacobian of a function of rows by complex steps: exact to rounding, no step size to choose (Squire and Trapp 1998)."""
    step = 1e-30
    return np.imag(function(values + 1j * step * np.eye(len(values)))).T / step


def lower_triangle(axes: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """`L` of `axes = L Q`, Q a rotation: the same axes in the frame of the triad."""
    turned = np.linalg.qr(axes.T)[1].T
    return turned * np.sign(np.diag(turned))[None, :]


def derivative(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Jacobian by central differences."""
    columns = [(function(at + step) - function(at - step)) / (2 * _STEP) for step in _STEP * np.eye(len(at))]
    return np.stack(columns, axis=1)
