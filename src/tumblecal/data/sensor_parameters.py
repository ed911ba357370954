"""Scale factors, biases, non-orthogonalities and mount angles of a calibration, with their covariance.

`A = diag(1 + dK) T f + bias`, T = [1 0 0; gamma_21 1 0; gamma_31 gamma_32 1], f in the triad's own frame.
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
# What a leaf's parameters are, and their unit.
GROUPS = {"dK": ("scale factors", "1"), "bias": ("biases", "g"), "gamma": ("non-orthogonality", "rad")}
GROUPS |= {"dtheta": ("mount", "rad")}
# Central differences: exact to about 1e-10 of the derivative.
_STEP = 1e-6


@dataclass(frozen=True)
class SensorParameters:
    """Values in base units (1, g, rad) by name; a covariance of zeros is one that nobody stated.

    - `undetermined`: names of those of which the sd is what is assumed of an effect beside them, for the data do not tell
      them from that.
    - `dof`: degrees of freedom of the noise's variance, infinite where the noise was stated: `covariance` is then known, else
      known but for a factor that is as uncertain as chi-square of `dof` over `dof`.
    - `noise`: the part of `covariance` that this factor multiplies, the rest being of a budget's inputs; None: all of it.
    """

    __repr__ = brief

    names: tuple[str, ...]
    values: Float[np.ndarray, " names"]
    covariance: Float[np.ndarray, "names names"]
    undetermined: tuple[str, ...] = ()
    dof: float = math.inf
    noise: Float[np.ndarray, "names names"] | None = None

    def places(self, names: Sequence[str]) -> list[int]:
        """Where parameters stand."""
        return [self.names.index(name) for name in names]

    def of(self, names: Sequence[str]) -> "SensorParameters":
        """Some of them."""
        places = self.places(names)
        left = tuple([name for name in self.undetermined if name in names])
        block = np.ix_(places, places)
        noise = None if self.noise is None else self.noise[block]
        return SensorParameters(tuple(names), self.values[places], self.covariance[block], left, self.dof, noise)

    @property
    def undetermined_words(self) -> str:
        """Which are not determined, with the sd that is assumed; "" where all are."""
        units = (shown(GROUPS[leaf_of(name)][1]) for name in self.undetermined)
        sizes = zip(self.undetermined, self.sd[self.places(self.undetermined)].tolist(), units, strict=True)
        return ", ".join([f"{name} (sd {in_words(f'{sd * scale:.2g}', unit)})" for name, sd, (unit, scale) in sizes])

    @property
    def sd(self) -> Float[np.ndarray, " names"]:
        """Standard deviations; 0 where nobody stated them."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def effective_dof(self) -> Float[np.ndarray, " names"]:
        """Degrees of freedom of each variance by Welch and Satterthwaite (JCGM 100, G.4), a budget's inputs having infinitely
        many; infinite where the noise was stated, or there is none."""
        variance = np.diag(self.covariance)
        own = variance if self.noise is None else np.diag(self.noise)
        sizes = np.sqrt(np.stack([own, np.maximum(variance - own, 0.0)]))
        return effective_dof(sizes, np.array([self.dof, np.inf]))


def leaf_of(name: str) -> str:
    """The leaf of a parameter: `dK` of `dK_x`."""
    return name.split("_")[0]


def of_matrix(
    matrix: Float[np.ndarray, "3 3"], bias: Float[np.ndarray, "3"], covariance: Float[np.ndarray, "12 12"]
) -> SensorParameters:
    """The sensor's parameters of a correction `f = matrix (A - bias)` in whatever frame; `covariance` is of the matrix' rows
    and the bias. A turn of the frame changes none of them."""

    def parameters(flat: np.ndarray) -> np.ndarray:
        lower = lower_triangle(np.linalg.inv(flat[:9].reshape(3, 3)))
        scales = np.diag(lower)
        return np.concatenate([scales - 1, flat[9:], (lower / scales[:, None])[[1, 2, 2], [0, 0, 1]]])

    flat = np.concatenate([np.ravel(matrix), bias])
    slope = derivative(parameters, flat)
    return SensorParameters(SENSOR, parameters(flat), slope @ covariance @ slope.T)


def triad_of(values: Inexact[np.ndarray, "*several 9"]) -> Inexact[np.ndarray, "*several 3 3"]:
    """`diag(1 + dK) T` of numbers in the order of `SENSOR`; complex ones as well, for derivatives by complex steps."""
    triad = np.zeros((*values.shape[:-1], 3, 3), values.dtype)
    triad[..., range(3), range(3)] = 1.0
    triad[..., [1, 2, 2], [0, 0, 1]] = values[..., 6:]
    return (1 + values[..., :3, None]) * triad


def lower_triangle(axes: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """`L` of `axes = L Q`, Q a rotation: the same axes in the triad's own frame."""
    turned = np.linalg.qr(axes.T)[1].T
    return turned * np.sign(np.diag(turned))[None, :]


def derivative(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Jacobian by central differences."""
    columns = [(function(at + step) - function(at - step)) / (2 * _STEP) for step in _STEP * np.eye(len(at))]
    return np.stack(columns, axis=1)
