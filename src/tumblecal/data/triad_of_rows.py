"""The linear correction of a triad: the same for all rows, or for each row at its temperature.

`A = diag(1 + dK) u + bias`, with the inputs along the sensitive axes `u = T f`, T = [1 0 0; gamma_21 1 0; gamma_31 gamma_32 1].
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.data.sensor_parameters import SensorParameters, triad_of
from tumblecal.data.temperature_curves import TemperatureCurves


Rows = Float[np.ndarray, "rows 3"]


@dataclass(frozen=True)
class ConstantTriad:
    """Matrix and bias of all rows."""

    matrix: Float[np.ndarray, "3 3"]
    bias: Float[np.ndarray, "3"]

    def force(self, readings: Rows) -> Rows:
        """Specific force from readings, g."""
        return (readings - self.bias) @ self.matrix.T

    def inputs(self, force: Rows) -> Rows:
        """Inputs along the sensitive axes from specific force, g."""
        lower = np.linalg.inv(self.matrix)
        return force @ (lower / np.diag(lower)[:, None]).T


@dataclass(frozen=True)
class TriadOfRows:
    """The triad of each row, in closed form: T is lower triangular with a unit diagonal. `rotation`: from its frame."""

    scale: Rows
    bias: Rows
    gamma: Rows
    rotation: Float[np.ndarray, "3 3"]

    def force(self, readings: Rows) -> Rows:
        """Specific force from readings, g."""
        x, y, z = ((readings - self.bias) / self.scale).T
        gamma_21, gamma_31, gamma_32 = self.gamma.T
        y = y - gamma_21 * x
        return np.stack([x, y, z - gamma_31 * x - gamma_32 * y]).T @ self.rotation.T

    def inputs(self, force: Rows) -> Rows:
        """Inputs along the sensitive axes from specific force, g."""
        x, y, z = np.linalg.solve(self.rotation, force.T)
        gamma_21, gamma_31, gamma_32 = self.gamma.T
        return np.stack([x, gamma_21 * x + y, gamma_31 * x + gamma_32 * y + z]).T


@dataclass(frozen=True)
class TriadByTemperature:
    """A triad whose parameters follow temperature: `matrix`, `bias` and `parameters` at the reference temperature."""

    matrix: Float[np.ndarray, "3 3"]
    bias: Float[np.ndarray, "3"]
    parameters: SensorParameters
    curves: TemperatureCurves

    def of_rows(self, degc: Float[np.ndarray, " rows"]) -> TriadOfRows:
        """The triad at the temperature of each row."""
        reference, changes = self.parameters.values, self.curves.at(degc)
        return TriadOfRows(
            1 + reference[:3] + changes[:, :3],
            self.bias + changes[:, 3:6],
            reference[6:] + changes[:, 6:],
            self.matrix @ triad_of(reference),
        )
