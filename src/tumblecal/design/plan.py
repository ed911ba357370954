"""The design of a measurement: positions, order, uncertainties, comparison with common practice."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.rig import Rig
from tumblecal.design.cells import Cells, cells_of
from tumblecal.design.common_plans import Positions, common_plans
from tumblecal.design.evaluation import Uncertainties, in_use_sd, uncertainties
from tumblecal.design.planned_rig import planned_rig
from tumblecal.design.responses import Responses, responses_of
from tumblecal.design.schedule import Schedule, continued, schedule
from tumblecal.effects.catalogue import Catalogue
from tumblecal.ground.errors import InputError


Order = Literal["keep", "random", "best"]
# Positions of a plan if neither their number nor the time is stated.
POSITIONS = 24
# Numbers of positions of the trade-off, relative to that of the plan.
_TRADED = (0.4, 0.6, 0.8, 1.0, 1.4, 2.0, 3.0)


@dataclass(frozen=True)
class Wanted:
    """A wanted plan.

    - `positions`, `minutes`: number of new positions, and time for them; None: not stated.
    - `criteria`: weights of the criteria by name. `parameters`: those that the criteria are about; none: all of the sensor.
    - `effects`: sizes of effects that are to be named, in the unit of each.
    - `order`: of the positions. `restarts`, `seed`: of the search.
    - `measured`: positions that are measured already. `compared`: further plans to compare.
    """

    positions: int | None = None
    minutes: float | None = None
    criteria: Mapping[str, float] = field(default_factory=lambda: {"worst": 1.0})
    parameters: tuple[str, ...] = ()
    effects: Mapping[str, float] = field(default_factory=dict)
    order: Order = "best"
    restarts: int = 4
    seed: int = 0
    measured: Positions | None = None
    compared: tuple[Positions, ...] = ()


@dataclass(frozen=True)
class Evaluated:
    """A plan with its uncertainties.

    - `positions`: once, as stated. `schedule`: of the plan as evaluated (repeated until the time is used).
    - `in_use` (attitudes, 3): standard uncertainty of the corrected force, g.
    - `fits`: whether one pass fits in the time.
    """

    positions: Positions
    schedule: Schedule
    uncertainties: Uncertainties
    in_use: Float[np.ndarray, "attitudes 3"]
    fits: bool = True

    @property
    def worst(self) -> tuple[str, float]:
        """The parameter with the largest standard uncertainty relative to its scale, and this uncertainty in base units."""
        sd = self.uncertainties.sd
        k = int(np.argmax(sd / self.uncertainties.scales))
        return self.uncertainties.names[k], float(sd[k])

    @property
    def in_use_average(self) -> float:
        """Root mean square over attitudes and axes, g; infinite if a parameter is not determined."""
        if self.uncertainties.undetermined:
            return float("inf")
        return float(np.sqrt(np.mean(self.in_use**2)))


class TradeOff(NamedTuple):
    """A point of the trade-off: number of positions, minutes, largest standard uncertainty (mg, mrad or 1e-3)."""

    positions: int
    minutes: float
    worst: float


@dataclass(frozen=True)
class DesignedPlan:
    """A designed plan.

    - `rig`: with the positions of the plan. `ability`: of the head. `wanted`: the request.
    - `responses`: of all cells. `names`: of the positions of `after.schedule`; `measured`: so many are measured already.
    - `after`: the plan. `before`: the positions that are measured already, otherwise the plan of the rig file.
    - `practice`: common practice, and plans to compare, in the same time.
    - `traded`: the trade-off between time and uncertainty.
    """

    rig: Rig
    ability: HeadAbility
    wanted: Wanted
    responses: Responses
    names: tuple[str, ...]
    measured: int
    after: Evaluated
    before: Evaluated
    practice: tuple[Evaluated, ...]
    traded: tuple[TradeOff, ...]

    @cached_property
    def cells(self) -> Cells:
        """The cells of all positions, in measuring order."""
        return self.responses.cells.chosen(self.after.schedule.cells)

    @property
    def minutes(self) -> float:
        """Time of the new positions."""
        start = self.after.schedule.start_s[self.measured] if self.measured else 0.0
        return float(self.after.schedule.end_s - start) / 60


def design_plan(rig: Rig, wanted: Wanted, entries: Catalogue) -> DesignedPlan:
    """Design a plan.

    **Arguments:**

    - `rig`: with what its head can do (`rig.ability`). `wanted`: the request. `entries`: the catalogue of effects.

    **Raises:** `InputError` for a request that the head cannot meet.
    """
    ability = rig.ability
    if ability is None:
        raise InputError(
            f"{rig.source}: no table [head]; write what the head can do, for example [head.times] dwell_s = 60"
        )
    space = _Space.of(rig, ability, wanted)
    kept = space.numbers["measured"] if wanted.measured else np.zeros(0, int)
    done = schedule(space.cells, kept, ability.times) if len(kept) else None
    chosen = _chosen(space, wanted, ability)
    planned = schedule(space.cells, chosen, ability.times)
    if done is not None:
        planned = continued(space.cells, done, chosen, ability.times)
    names = _names(wanted.measured, len(planned))
    after = space.evaluated(Positions("this plan", "", (), (), ()), planned)
    if wanted.minutes is not None and planned.minutes > wanted.minutes:
        raise InputError(f"--minutes {wanted.minutes:g}: these {len(chosen)} positions take {planned.minutes:.0f} min")
    before_positions = wanted.measured or _of_rig(rig)
    before_order = kept if done is not None else space.numbers["rig"]
    before = space.evaluated(before_positions, schedule(space.cells, before_order, ability.times))
    practice = tuple(
        space.in_time(positions, space.numbers[f"practice {k}"], planned.minutes)
        for k, positions in enumerate(space.practice)
    )
    return DesignedPlan(
        rig=planned_rig(rig, space.responses, planned, ability, names, wanted.seed),
        ability=ability,
        wanted=wanted,
        responses=space.responses,
        names=names,
        measured=len(kept),
        after=after,
        before=before,
        practice=practice,
        traded=(),
    )


@dataclass(frozen=True)
class _Space:
    """All cells of a design: those of the head (the first `allowed`), and those of plans to compare, by their numbers."""

    responses: Responses
    use: Responses
    ability: HeadAbility
    allowed: int
    practice: tuple[Positions, ...]
    numbers: Mapping[str, Int[np.ndarray, " positions"]]

    @property
    def cells(self) -> Cells:
        return self.responses.cells

    @classmethod
    def of(cls, rig: Rig, ability: HeadAbility, wanted: Wanted) -> "_Space":
        cells, numbers = cells_of(ability), dict[str, np.ndarray]()
        allowed = len(cells)
        practice = (*common_plans(ability, rig.mounts, wanted.seed), *wanted.compared)
        listed = {"rig": _of_rig(rig)} | {f"practice {k}": each for k, each in enumerate(practice)}
        if wanted.measured is not None:
            listed["measured"] = wanted.measured
        for name, positions in listed.items():
            cells, numbers[name] = cells.joined(_cells(positions, ability))
        return cls(responses_of(rig, cells), responses_of(rig, _sphere(ability)), ability, allowed, practice, numbers)

    def evaluated(self, positions: Positions, planned: Schedule, *, fits: bool = True) -> Evaluated:
        found = uncertainties(self.responses, planned, self.ability)
        return Evaluated(positions, planned, found, in_use_sd(self.use, found.covariance), fits)

    def in_time(self, positions: Positions, once: Int[np.ndarray, " positions"], minutes: float) -> Evaluated:
        """Positions of each mounting repeated, without remounting, until the time is used."""
        times, mounting = self.ability.times, self.cells.mounting[once]
        blocks = np.split(once, 1 + np.flatnonzero(np.diff(mounting)))

        def repeated(passes: int) -> Schedule:
            return schedule(self.cells, np.concatenate([np.tile(block, passes) for block in blocks]), times)

        passes = 1
        while repeated(passes + 1).minutes <= minutes:
            passes += 1
        planned = repeated(passes)
        # The last mounting gets the rest of the time.
        longer = schedule(self.cells, np.concatenate([planned.cells, np.tile(blocks[-1], passes + len(once))]), times)
        count = int(np.sum(longer.start_s + times.dwell_s <= 60 * minutes + 1e-6))
        if count > len(planned):
            planned = schedule(self.cells, longer.cells[:count], times)
        return self.evaluated(positions, planned, fits=planned.minutes <= minutes + 1e-6)


def _chosen(space: _Space, wanted: Wanted, ability: HeadAbility) -> Int[np.ndarray, " new"]:
    """The numbers of the new positions, in measuring order."""
    count = wanted.positions or POSITIONS
    return np.unique(np.linspace(0, space.allowed - 1, count).astype(int))


def _names(measured: Positions | None, count: int) -> tuple[str, ...]:
    """Names of all positions: those measured, then numbers."""
    first = 0 if measured is None else len(measured)
    return (
        tuple(str(number) for number in range(1, count + 1))
        if not first
        else (
            *(f"measured {k + 1}" for k in range(first)),
            *(str(k + 1) for k in range(count - first)),
        )
    )


def _of_rig(rig: Rig) -> Positions:
    plan = rig.plan
    return Positions("plan of the rig file", "", plan.alpha_deg, plan.beta_deg, plan.mounts)


def _cells(positions: Positions, ability: HeadAbility) -> Cells:
    degc = ability.temperatures_degc
    count = len(positions)
    temperature = np.full(count, float(np.median(degc))) if degc else None
    return Cells(np.array(positions.alpha_deg), np.array(positions.beta_deg), positions.mounts, temperature)


def _sphere(ability: HeadAbility, count: int = 200) -> Cells:
    """Attitudes evenly over the sphere (a spiral), in the first mounting."""
    k = np.arange(count) + 0.5
    beta = np.degrees(np.arcsin(1 - 2 * k / count))
    alpha = np.degrees(np.pi * (1 + 5**0.5) * k) % 360
    degc = ability.temperatures_degc
    return Cells(alpha, beta, ability.mounts[:1] * count, np.full(count, float(np.median(degc))) if degc else None)
