"""Cells that a position of a plan may occupy: a spindle angle, a pitch setting, a mounting, a temperature."""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Where, settings
from tumblecal.chain.head_ability import HeadAbility


@dataclass(frozen=True)
class Cells:
    """Candidates for positions, one entry each; `temperature_degc`: None without a chamber."""

    alpha_deg: Float[np.ndarray, " cells"]
    beta_deg: Float[np.ndarray, " cells"]
    mounts: tuple[str, ...]
    temperature_degc: Float[np.ndarray, " cells"] | None = None

    def __len__(self) -> int:
        return len(self.alpha_deg)

    def chosen(self, numbers: Int[np.ndarray, " chosen"]) -> "Cells":
        """Some of the cells, in this order."""
        degc = self.temperature_degc
        return Cells(
            self.alpha_deg[numbers],
            self.beta_deg[numbers],
            tuple(self.mounts[k] for k in numbers),
            None if degc is None else degc[numbers],
        )

    def joined(self, other: "Cells") -> tuple["Cells", Int[np.ndarray, " other"]]:
        """These cells with those of the other that are not among them, and the number of each of the other's cells."""
        number, new = {key: k for k, key in enumerate(self._keys)}, list[int]()
        for k, key in enumerate(other._keys):
            if key not in number:
                number[key] = len(self) + len(new)
                new.append(k)
        numbers, added = np.array([number[key] for key in other._keys], int), other.chosen(np.array(new, int))
        degc = None
        if self.temperature_degc is not None and added.temperature_degc is not None:
            degc = np.concatenate([self.temperature_degc, added.temperature_degc])
        alpha = np.concatenate([self.alpha_deg, added.alpha_deg])
        beta = np.concatenate([self.beta_deg, added.beta_deg])
        return Cells(alpha, beta, self.mounts + added.mounts, degc), numbers

    @property
    def _keys(self) -> list[tuple]:
        degc = np.zeros(len(self)) if self.temperature_degc is None else self.temperature_degc
        columns = np.round([self.alpha_deg % 360.0, self.beta_deg, degc], 6).T.tolist()
        return [(*column, mount) for column, mount in zip(columns, self.mounts, strict=True)]

    @cached_property
    def where(self) -> Where:
        """The settings of all cells."""
        return settings(
            np.radians(self.alpha_deg),
            np.radians(self.beta_deg),
            mount=self.mounts,
            temperature_degc=self.temperature_degc,
        )

    @cached_property
    def mounting(self) -> Int[np.ndarray, " cells"]:
        """Number of the mounting of each cell."""
        order = list(dict.fromkeys(self.mounts))
        return np.array([order.index(label) for label in self.mounts], int)

    @cached_property
    def pitch(self) -> Int[np.ndarray, " cells"]:
        """Number of the pitch setting of each cell, by increasing angle."""
        return np.unique(np.round(self.beta_deg, 9), return_inverse=True)[1].ravel()

    @cached_property
    def soak(self) -> Int[np.ndarray, " cells"]:
        """Number of the temperature of each cell, by increasing temperature."""
        if self.temperature_degc is None:
            return np.zeros(len(self), int)
        return np.unique(self.temperature_degc, return_inverse=True)[1].ravel()

    @cached_property
    def group(self) -> Int[np.ndarray, " cells"]:
        """Number of the combination of temperature, mounting and pitch setting."""
        columns = np.stack([self.soak, self.mounting, self.pitch], axis=1)
        return np.unique(columns, axis=0, return_inverse=True)[1].ravel()


def cells_of(ability: HeadAbility) -> Cells:
    """Every spindle angle at every pitch setting, mounting and temperature that a head can set."""
    degc = ability.temperatures_degc
    listed = list(product(degc or (0.0,), ability.mounts, ability.beta_deg, ability.alpha_deg))
    temperatures, mounts, beta, alpha = zip(*listed, strict=True)
    return Cells(np.array(alpha), np.array(beta), mounts, np.array(temperatures) if degc else None)
