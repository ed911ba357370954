"""The positions of a measuring plan, before anything is measured."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Plan:
    """Commanded angles in degrees, and the labels of each position.

    `names`, `alpha_deg`, `beta_deg`, `mounts`, `runs` have one entry for each position, in measuring order. So do time (s),
    temperature (degC) and approach (+1 or -1) if planned.
    """

    names: tuple[str, ...]
    alpha_deg: tuple[float, ...]
    beta_deg: tuple[float, ...]
    mounts: tuple[str, ...]
    runs: tuple[str, ...]
    time_s: tuple[float, ...] | None = None
    temperature_degc: tuple[float, ...] | None = None
    approach: tuple[float, ...] | None = None

    def __len__(self) -> int:
        return len(self.names)

    @property
    def alpha(self) -> np.ndarray:
        """Spindle angles, rad."""
        return np.radians(self.alpha_deg)

    @property
    def beta(self) -> np.ndarray:
        """Pitch angles, rad."""
        return np.radians(self.beta_deg)


def grid(
    alpha_deg: Sequence[float] | np.ndarray,
    beta_deg: Sequence[float] | np.ndarray,
    *,
    mounts: Sequence[str] = ("1",),
    runs: int = 1,
) -> Plan:
    """Every spindle angle at every pitch setting, for every mount, repeated for each run.

    Positions are named as in the paper: pitch setting, dash, place within it (`0-1` ... `2-8`).
    """
    cells = [
        (f"{setting}-{place + 1}", alpha, beta, mount, str(run + 1))
        for run in range(runs)
        for mount in mounts
        for setting, beta in enumerate(beta_deg)
        for place, alpha in enumerate(alpha_deg)
    ]
    names, alphas, betas, mount_labels, run_labels = zip(*cells, strict=True)
    return Plan(names, alphas, betas, mount_labels, run_labels)
