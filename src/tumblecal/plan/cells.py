"""Cells that a position of a plan may occupy: a spindle angle, a pitch setting, a mounting, a temperature."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, product

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Where, settings
from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.plan import Plan


# A sitting: number of the temperature, and of the mounting.
Sitting = tuple[int, int]


@dataclass(frozen=True)
class Cells:
    """Candidates for positions, one entry each; `temperature_degc`: None without a chamber."""

    alpha_deg: Float[np.ndarray, " cells"]
    beta_deg: Float[np.ndarray, " cells"]
    mounts: tuple[str, ...]
    temperature_degc: Float[np.ndarray, " cells"] | None = None

    @classmethod
    def listed(
        cls, rows: Sequence[tuple[float, float, str]], temperature_degc: Sequence[float] | np.ndarray | None = None
    ) -> "Cells":
        """Cells from their angles and mounting."""
        alpha, beta, mounts = zip(*rows, strict=True)
        degc = None if temperature_degc is None else np.array(temperature_degc, float)
        return cls(np.array(alpha, float), np.array(beta, float), mounts, degc)

    def __len__(self) -> int:
        return len(self.alpha_deg)

    def chosen(self, numbers: Int[np.ndarray, " chosen"]) -> "Cells":
        """Some of the cells, in this order."""
        degc = None if self.temperature_degc is None else self.temperature_degc[numbers]
        return Cells(self.alpha_deg[numbers], self.beta_deg[numbers], tuple(self.mounts[k] for k in numbers), degc)

    def joined(self, *others: "Cells") -> "Cells":
        """These cells followed by others; temperatures only if all have them."""
        every = (self, *others)
        alpha, beta = (
            np.concatenate(each) for each in zip(*((one.alpha_deg, one.beta_deg) for one in every), strict=True)
        )
        degc = [one.temperature_degc for one in every if one.temperature_degc is not None]
        mounts = tuple(chain.from_iterable(one.mounts for one in every))
        return Cells(alpha, beta, mounts, np.concatenate(degc) if len(degc) == len(every) else None)

    def plan(self, names: Sequence[str], time_s: Float[np.ndarray, " cells"] | None) -> Plan:
        """The positions of a rig in these cells."""
        alpha, beta, degc, time = (
            None if column is None else tuple(column.tolist())
            for column in (self.alpha_deg, self.beta_deg, self.temperature_degc, time_s)
        )
        assert alpha is not None and beta is not None
        return Plan(tuple(names), alpha, beta, self.mounts, ("1",) * len(self), time_s=time, temperature_degc=degc)

    @cached_property
    def where(self) -> Where:
        """The settings of all cells."""
        alpha, beta = np.radians(self.alpha_deg), np.radians(self.beta_deg)
        return settings(alpha, beta, mount=self.mounts, temperature_degc=self.temperature_degc)

    @cached_property
    def mounting(self) -> Int[np.ndarray, " cells"]:
        """Number of the mounting of each cell."""
        order = {label: k for k, label in enumerate(dict.fromkeys(self.mounts))}
        return np.array([order[label] for label in self.mounts], int)

    @cached_property
    def pitch(self) -> Int[np.ndarray, " cells"]:
        """Number of the pitch setting of each cell, by increasing angle."""
        return np.unique(np.round(self.beta_deg, 9), return_inverse=True)[1].ravel()

    @cached_property
    def soak(self) -> Int[np.ndarray, " cells"]:
        """Number of the temperature of each cell, by increasing temperature."""
        degc = np.zeros(len(self)) if self.temperature_degc is None else self.temperature_degc
        return np.unique(degc, return_inverse=True)[1].ravel()

    @cached_property
    def sittings(self) -> list[Sitting]:
        """Temperature and mounting of each cell, by their numbers."""
        return list(zip(self.soak.tolist(), self.mounting.tolist(), strict=True))

    @cached_property
    def setting(self) -> Int[np.ndarray, " cells"]:
        """Number of the combination of mounting and pitch setting."""
        return _combined(self.mounting, self.pitch)

    @cached_property
    def sitting(self) -> Int[np.ndarray, " cells"]:
        """Number of the combination of temperature and mounting."""
        return _combined(self.soak, self.mounting)

    @cached_property
    def group(self) -> Int[np.ndarray, " cells"]:
        """Number of the combination of temperature, mounting and pitch setting."""
        return _combined(self.sitting, self.pitch)


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
        once = np.arange(len(self.cells))
        rows = np.concatenate([once[:: -1 if k % 2 else 1] for k in range(len(temperatures_degc))])
        degc = np.repeat(np.array(temperatures_degc, float), len(once))
        return replace(self, cells=replace(self.cells.chosen(rows), temperature_degc=degc))


def cells_of(ability: HeadAbility) -> Cells:
    """Every spindle angle at every pitch setting, mounting and temperature that a head can set."""
    degc = ability.temperatures_degc
    listed = list(product(degc or (0.0,), ability.mounts, ability.beta_deg, ability.alpha_deg))
    rows = [(alpha, beta, mount) for _, mount, beta, alpha in listed]
    return Cells.listed(rows, [one[0] for one in listed] if degc else None)


def _combined(first: Int[np.ndarray, " cells"], second: Int[np.ndarray, " cells"]) -> Int[np.ndarray, " cells"]:
    """Number of each combination of two numbers."""
    return np.unique(np.stack([first, second], axis=1), axis=0, return_inverse=True)[1].ravel()
