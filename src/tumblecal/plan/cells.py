"""Cells that a position of a plan may occupy: a spindle angle, a pitch setting, a mounting, a temperature."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Where, settings
from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.plan import Plan


# Numbers of cells.
Numbers = Int[np.ndarray, "*n positions"]
# A number for each cell, equal for cells that are equal in one respect.
Labels = Int[np.ndarray, " cells"]


@dataclass(frozen=True)
class Cells:
    """Candidates for positions, one entry each; `temperature_degc`: None without a chamber."""

    alpha_deg: Float[np.ndarray, " cells"]
    beta_deg: Float[np.ndarray, " cells"]
    mounts: tuple[str, ...]
    temperature_degc: Float[np.ndarray, " cells"] | None = None

    @classmethod
    def listed(cls, rows: Iterable[tuple], temperature_degc: Sequence[float] | np.ndarray | None = None) -> "Cells":
        """Cells from their spindle angle, pitch setting and mounting."""
        alpha, beta, mounts = zip(*rows, strict=True)
        degc = None if temperature_degc is None else np.array(temperature_degc, float)
        return cls(np.array(alpha, float), np.array(beta, float), mounts, degc)

    def __len__(self) -> int:
        return len(self.alpha_deg)

    @property
    def rows(self) -> list[tuple]:
        """Spindle angle, pitch setting and mounting of each cell."""
        return list(zip(self.alpha_deg.tolist(), self.beta_deg.tolist(), self.mounts, strict=True))

    def chosen(self, numbers: Numbers) -> "Cells":
        """Some of the cells, in this order."""
        degc = self.temperature_degc
        mounts = tuple(self.mounts[k] for k in numbers)
        return Cells(self.alpha_deg[numbers], self.beta_deg[numbers], mounts, None if degc is None else degc[numbers])

    def plan(self, names: Sequence[str], time_s: Float[np.ndarray, " cells"] | None) -> Plan:
        """The positions of a rig in these cells."""
        time, degc = (None if each is None else tuple(each.tolist()) for each in (time_s, self.temperature_degc))
        alpha, beta = tuple(self.alpha_deg.tolist()), tuple(self.beta_deg.tolist())
        return Plan(tuple(names), alpha, beta, self.mounts, ("1",) * len(self), time_s=time, temperature_degc=degc)

    @cached_property
    def where(self) -> Where:
        """The settings of all cells."""
        alpha, beta = np.radians(self.alpha_deg), np.radians(self.beta_deg)
        return settings(alpha, beta, mount=self.mounts, temperature_degc=self.temperature_degc)

    @cached_property
    def mounting(self) -> Labels:
        """Number of the mounting, in the order in which they are listed first."""
        order = list(dict.fromkeys(self.mounts))
        return np.array([order.index(label) for label in self.mounts], int)

    @cached_property
    def pitch(self) -> Labels:
        """Number of the pitch setting, by increasing angle."""
        return _numbered(np.round(self.beta_deg, 9))

    @cached_property
    def soak(self) -> Labels:
        """Number of the temperature, by increasing temperature."""
        return np.zeros(len(self), int) if self.temperature_degc is None else _numbered(self.temperature_degc)

    @cached_property
    def setting(self) -> Labels:
        """Number of the combination of mounting and pitch setting."""
        return _numbered(self.mounting, self.pitch)

    @cached_property
    def sitting(self) -> Labels:
        """Number of the combination of temperature and mounting, in measuring order: mountings there and back."""
        return _numbered(self.soak, np.where(self.soak % 2, -self.mounting, self.mounting))

    @cached_property
    def group(self) -> Labels:
        """Number of the combination with the pitch setting, in measuring order: pitch settings there and back."""
        return _numbered(self.sitting, np.where(self.sitting % 2, -self.pitch, self.pitch))


@dataclass(frozen=True)
class Positions:
    """Positions of a plan in measuring order: its name, its source, and their cells.

    `deviation_deg`: largest angle between the intended direction of gravity and the nearest one that the head can set.
    """

    name: str
    source: str
    cells: Cells
    deviation_deg: float = 0.0

    def at_each(self, temperatures_degc: Sequence[float]) -> "Positions":
        """All positions at each temperature, every second time in the reverse order: the mounting stays when it changes."""
        once, count = np.arange(len(self.cells)), len(temperatures_degc)
        rows = np.concatenate([once[:: -1 if k % 2 else 1] for k in range(count)])
        degc = np.repeat(np.array(temperatures_degc, float), len(once))
        return replace(self, cells=replace(self.cells.chosen(rows), temperature_degc=degc))


def cells_of(ability: HeadAbility) -> Cells:
    """Every spindle angle at every pitch setting, mounting and temperature that a head can set."""
    degc = ability.temperatures_degc
    once = [(alpha, beta, mount) for mount, beta, alpha in product(ability.mounts, ability.beta_deg, ability.alpha_deg)]
    return Cells.listed(once * max(1, len(degc)), np.repeat(degc, len(once)) if degc else None)


def _numbered(*labels: np.ndarray) -> Labels:
    """Number of each combination of some labels, in sorted order."""
    return np.unique(np.stack(labels, axis=1), axis=0, return_inverse=True)[1].ravel()
