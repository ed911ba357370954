"""All positions of a design: those that the head can measure, those measured already, and those of plans to compare."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.rig import Rig
from tumblecal.ground.errors import InputError
from tumblecal.ground.soaks import ONE_TEMPERATURE_DEGC, soak_numbers
from tumblecal.plan.cells import Cells, cells_of
from tumblecal.plan.common_plans import Positions
from tumblecal.plan.criterion import attitudes_in_use
from tumblecal.plan.forecast.naming import EffectForecast
from tumblecal.plan.responses import Responses, responses_of
from tumblecal.plan.schedule import Schedule, schedule
from tumblecal.plan.uncertainties import Uncertainties, in_use_sd, uncertainties


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
        places = [k for k, name in enumerate(found.names) if name in self.compared]
        k = max(places, key=lambda k: found.sd[k] / found.scales[k])
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
class Candidates:
    """Responses of all positions.

    - `responses`: the cells of the head come first, `of_head` of them, then those measured already and those of other plans.
      `use`: of attitudes in use.
    - `numbers`: cells of other plans by their names; `measured`: of the positions that are measured already.
    """

    responses: Responses
    use: Responses
    ability: HeadAbility
    of_head: int
    measured: Int[np.ndarray, " measured"]
    numbers: Mapping[str, Int[np.ndarray, " positions"]]

    @property
    def done(self) -> Schedule | None:
        """The schedule of the positions that are measured already; None: there are none."""
        return schedule(self.responses.cells, self.measured, self.ability.times) if len(self.measured) else None

    def evaluated(self, positions: Positions, planned: Schedule, *, fits: bool = True) -> Evaluated:
        """A schedule of these cells with its uncertainties."""
        found = uncertainties(self.responses, planned, self.ability)
        return Evaluated(positions, planned, found, in_use_sd(self.use, found.covariance), fits)

    def in_time(self, positions: Positions, once: Int[np.ndarray, " positions"], minutes: float) -> Evaluated:
        """Positions of each mounting and temperature repeated, without remounting, until the time is used."""
        cells, times = self.responses.cells, self.ability.times
        changed = (np.diff(cells.mounting[once]) != 0) | (np.diff(cells.soak[once]) != 0)
        blocks = np.split(once, 1 + np.flatnonzero(changed))

        def repeated(passes: int, more: int = 0) -> Schedule:
            """The last mounting gets the rest of the time."""
            rows = [np.tile(block, passes) for block in blocks]
            return schedule(cells, np.concatenate([*rows, np.tile(blocks[-1], more)]), times)

        passes = 1
        while repeated(passes + 1).minutes <= minutes:
            passes += 1
        planned, longer = repeated(passes), repeated(passes, passes + len(once))
        count = int(np.sum(longer.start_s + times.dwell_s <= 60 * minutes + 1e-6))
        planned = schedule(cells, longer.cells[: max(count, len(planned))], times)
        return self.evaluated(positions, planned, fits=planned.minutes <= minutes + 1e-6)


def candidates_of(
    rig: Rig, ability: HeadAbility, measured: Positions | None, others: Mapping[str, Positions]
) -> Candidates:
    """The positions of a head, of a measurement and of other plans by name.

    **Raises:** `InputError` for a rig with effects of time.
    """
    cells = cells_of(ability)
    of_head, numbers = len(cells), dict[str, np.ndarray]()
    for name, positions in [*([] if measured is None else [("", measured)]), *others.items()]:
        cells, numbers[name] = cells.joined(_cells(positions, ability))
    try:
        responses, use = responses_of(rig, cells), responses_of(rig, attitudes_in_use(ability))
    except InputError as error:
        if not (rig.effects or rig.temperature.leaves):
            raise
        raise InputError(
            f"{rig.source}: {str(error).removeprefix(f'{rig.source}: ')} (a plan is designed for settings without times): "
            "remove such effects from chain.effects, and state the temperatures of a chamber in [head] temperatures_degc"
        ) from error
    return Candidates(responses, use, ability, of_head, numbers.pop("", np.zeros(0, int)), numbers)


def _cells(positions: Positions, ability: HeadAbility) -> Cells:
    """Cells at the stated temperatures, otherwise at the middle one of the chamber."""
    chamber, stated, temperature = ability.temperatures_degc, positions.temperature_degc, None
    if chamber:
        temperature = np.full(len(positions), float(np.median(chamber))) if stated is None else _soaked(stated, chamber)
    return Cells(np.array(positions.alpha_deg), np.array(positions.beta_deg), positions.mounts, temperature)


def _soaked(degc: Sequence[float], chamber: Sequence[float]) -> Float[np.ndarray, " positions"]:
    """Measured temperatures: the mean of each soak, or the temperature of the chamber that it is equal to."""
    measured, listed = np.array(degc, float), np.array(chamber)
    if (number := soak_numbers(measured)) is not None:
        measured = (np.bincount(number, measured) / np.bincount(number))[number]
    nearest = listed[np.argmin(np.abs(measured[:, None] - listed), axis=1)]
    return np.where(np.abs(measured - nearest) <= ONE_TEMPERATURE_DEGC, nearest, measured)
