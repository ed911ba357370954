"""A designed plan: its positions, uncertainties, bounds and trade-off, and the plans that it is compared with."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.nominal import UNIT_OF_LEAF, unit_of_parameter
from tumblecal.chain.rig import Rig
from tumblecal.ground.record import rows, table
from tumblecal.plan.bound import Bounds
from tumblecal.plan.cells import Cells, Positions
from tumblecal.plan.criterion import Criterion
from tumblecal.plan.forecast.record import EffectForecast, NamingForecast
from tumblecal.plan.information import Uncertainties
from tumblecal.plan.limits import Schedule
from tumblecal.plan.order import Ordered
from tumblecal.plan.request import Wanted
from tumblecal.plan.responses import Responses


@dataclass(frozen=True)
class Worst:
    """A parameter and its standard uncertainty, base units."""

    parameter: str
    u: float


@dataclass(frozen=True)
class InUse:
    """Standard uncertainty of the corrected force, g: root mean square over attitudes and axes, and the largest one."""

    average: float
    largest: float


@dataclass(frozen=True)
class Evaluated:
    """A plan with its uncertainties.

    - `positions`: once, as stated. `schedule`: of the plan as evaluated (repeated until the time is used).
    - `in_use` (attitudes, 3): standard uncertainty of the corrected force, g.
    - `fits`: whether one pass fits in the time.
    - `effects`, `undetectable`: forecasts of the effects to be named, and ids of effects that the plan cannot show; None: not
      evaluated.
    - `compared`: parameters to compare with another plan.
    """

    positions: Positions
    schedule: Schedule
    uncertainties: Uncertainties
    in_use: Float[np.ndarray, "attitudes 3"]
    fits: bool = True
    effects: tuple[EffectForecast, ...] = ()
    undetectable: tuple[str, ...] | None = None
    compared: tuple[str, ...] = ()

    @property
    def worst(self) -> Worst:
        """The parameter to compare with the largest standard uncertainty relative to its scale."""
        found = self.uncertainties
        relative = np.where(np.isin(found.names, self.compared), found.sd / found.scales, -1.0)
        k = int(np.argmax(relative))
        return Worst(found.names[k], float(found.sd[k]))

    @property
    def missing(self) -> list[str]:
        """The parameters to compare that are not determined."""
        return [name for name in self.uncertainties.undetermined if name in self.compared]

    @property
    def in_use_g(self) -> InUse:
        """Standard uncertainty of the corrected force; infinite if a parameter is not determined."""
        if self.uncertainties.undetermined:
            return InUse(np.inf, np.inf)
        return InUse(float(np.sqrt(np.mean(self.in_use**2))), float(np.max(self.in_use)))


@dataclass(frozen=True)
class TradeOff:
    """A point of the trade-off: number of positions, minutes, and the criterion with slow noise known."""

    positions: int
    minutes: float
    value: float


@dataclass(frozen=True)
class Found:
    """A plan that was searched.

    - `criterion`: of the covariance. `ordered`: the positions, those measured already first.
    - `bounds`: None if the positions are chosen by other criteria too. `traded`: the trade-off, by increasing time.
    """

    criterion: Criterion
    ordered: Ordered
    bounds: Bounds | None
    traded: tuple[TradeOff, ...]


@dataclass(frozen=True)
class DesignedPlan:
    """A designed plan.

    - `rig`: with the positions of the plan. `ability`: of the head. `wanted`: the request.
    - `responses`: of all cells. `names`: of the positions of `after.schedule`; `measured`: so many are measured already.
    - `found`: criterion, order, bounds and trade-off.
    - `after`: the plan. `before`: the positions that are measured already, otherwise the plan of the rig file.
    - `practice`: common practice, and plans to compare, in the same time.
    - `forecast`: of the diagnosis.
    """

    rig: Rig
    ability: HeadAbility
    wanted: Wanted
    responses: Responses
    names: tuple[str, ...]
    measured: int
    found: Found
    after: Evaluated
    before: Evaluated
    practice: tuple[Evaluated, ...]
    forecast: NamingForecast | None

    @cached_property
    def cells(self) -> Cells:
        """The cells of all positions, in measuring order."""
        return self.responses.cells.chosen(self.after.schedule.cells)

    @cached_property
    def positions(self) -> list[dict[str, Any]]:
        """Name, angles, mounting and temperature of each position, in measuring order, as in files."""
        cells, degc = self.cells, self.cells.temperature_degc
        alpha, beta = (np.round(angle, 9).tolist() for angle in (cells.alpha_deg, cells.beta_deg))
        further = {} if degc is None else {"temperature_degc": np.round(degc, 9).tolist()}
        return rows(name=self.names, alpha_deg=alpha, beta_deg=beta, mount=cells.mounts, **further)

    @property
    def scheduled(self) -> list[dict[str, Any]]:
        """The positions with the start of each dwell (s), and whether they are measured already."""
        times = rows(start_s=self.after.schedule.start_s, measured=np.arange(len(self.names)) < self.measured)
        return [position | time for position, time in zip(self.positions, times, strict=True)]

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Standard uncertainty with the plan (`u`) and without (`u_before`), and base unit, of each shared parameter."""
        before, after = self.before.uncertainties.sd.tolist(), self.after.uncertainties
        units = [unit_of_parameter(name, UNIT_OF_LEAF) or "1" for name in after.names]
        return table(after.names, u=after.sd.tolist(), u_before=before, unit=units)

    def ratio(self, other: Evaluated) -> float:
        """The largest standard uncertainty of another plan, relative to that of this plan."""
        scale_of = dict(zip(self.after.uncertainties.names, self.after.uncertainties.scales.tolist(), strict=True))
        worst, own = (plan.worst.u / scale_of[plan.worst.parameter] for plan in (other, self.after))
        return worst / own

    @property
    def minutes(self) -> float:
        """Time of the new positions."""
        start = self.after.schedule.start_s[self.measured] if self.measured else 0.0
        return float(self.after.schedule.end_s - start) / 60
