"""All positions of a design: those that the head can measure, those measured already, and those of plans to compare."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.rig import Rig
from tumblecal.design.common_plans import Positions
from tumblecal.design.criteria.criterion import attitudes_in_use
from tumblecal.design.forecast.naming import EffectForecast
from tumblecal.design.model.cells import Cells, cells_of
from tumblecal.design.model.evaluation import Uncertainties, in_use_sd, uncertainties
from tumblecal.design.model.responses import Responses, responses_of
from tumblecal.design.model.schedule import Schedule, schedule
from tumblecal.ground.errors import InputError
from tumblecal.ground.soaks import ONE_TEMPERATURE_DEGC, soak_numbers


@dataclass(frozen=True)
class Evaluated:
    """A plan with its uncertainties.

    - `positions`: once, as stated. `schedule`: of the plan as evaluated (repeated until the time is used).
    - `in_use` (attitudes, 3): standard uncertainty of the corrected force, g.
    - `fits`: whether one pass fits in the time.
    - `effects`, `undetectable`: forecasts of the effects to be named, and ids of effects that the plan cannot show; None: not
      evaluated.
    """

    positions: Positions
    schedule: Schedule
    uncertainties: Uncertainties
    in_use: Float[np.ndarray, "attitudes 3"]
    fits: bool = True
    effects: tuple[EffectForecast, ...] = ()
    undetectable: tuple[str, ...] | None = None

    def worst(self, names: Collection[str]) -> tuple[str, float]:
        """The parameter among some with the largest standard uncertainty relative to its scale, and this uncertainty in base
        units."""
        places = [k for k, name in enumerate(self.uncertainties.names) if name in names]
        k = max(places, key=lambda k: self.uncertainties.sd[k] / self.uncertainties.scales[k])
        return self.uncertainties.names[k], float(self.uncertainties.sd[k])

    def undetermined(self, names: Collection[str]) -> list[str]:
        """Those of some parameters that are not determined."""
        return [name for name in self.uncertainties.undetermined if name in names]

    @property
    def in_use_average(self) -> float:
        """Root mean square over attitudes and axes, g; infinite if a parameter is not determined."""
        if self.uncertainties.undetermined:
            return float("inf")
        return float(np.sqrt(np.mean(self.in_use**2)))

    @property
    def in_use_largest(self) -> float:
        """The largest one, g; infinite if a parameter is not determined."""
        return float("inf") if self.uncertainties.undetermined else float(np.max(self.in_use))


@dataclass(frozen=True)
class Candidates:
    """Responses of all positions.

    - `responses`: the cells of the head come first, `of_head` of them, then those of other plans. `use`: of attitudes in use.
    - `numbers`: cells of other plans by their names.
    """

    responses: Responses
    use: Responses
    ability: HeadAbility
    of_head: int
    numbers: Mapping[str, Int[np.ndarray, " positions"]]

    @classmethod
    def of(cls, rig: Rig, ability: HeadAbility, others: Mapping[str, Positions]) -> "Candidates":
        """The positions of a head, and of other plans by name."""
        cells, numbers = cells_of(ability), dict[str, np.ndarray]()
        of_head = len(cells)
        for name, positions in others.items():
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
        return cls(responses, use, ability, of_head, numbers)

    @property
    def measured(self) -> Int[np.ndarray, " measured"]:
        """Numbers of the positions that are measured already."""
        return self.numbers.get("measured", np.zeros(0, int))

    def choices(
        self, measured: Int[np.ndarray, " measured"]
    ) -> tuple[Int[np.ndarray, " cells"], Bool[np.ndarray, " cells"]]:
        """Numbers of the cells of a search: those of the head, and those measured already; and which of them may be chosen."""
        cells = np.concatenate([np.arange(self.of_head), np.unique(measured[measured >= self.of_head])])
        return cells, cells < self.of_head

    def evaluated(self, positions: Positions, planned: Schedule, *, fits: bool = True) -> Evaluated:
        """A schedule of these cells with its uncertainties."""
        found = uncertainties(self.responses, planned, self.ability)
        return Evaluated(positions, planned, found, in_use_sd(self.use, found.covariance), fits)

    def in_time(self, positions: Positions, once: Int[np.ndarray, " positions"], minutes: float) -> Evaluated:
        """Positions of each mounting and temperature repeated, without remounting, until the time is used."""
        cells, times = self.responses.cells, self.ability.times
        changed = (np.diff(cells.mounting[once]) != 0) | (np.diff(cells.soak[once]) != 0)
        blocks = np.split(once, 1 + np.flatnonzero(changed))

        def repeated(passes: int) -> Schedule:
            return schedule(cells, np.concatenate([np.tile(block, passes) for block in blocks]), times)

        passes = 1
        while repeated(passes + 1).minutes <= minutes:
            passes += 1
        planned = repeated(passes)
        # The last mounting gets the rest of the time.
        longer = schedule(cells, np.concatenate([planned.cells, np.tile(blocks[-1], passes + len(once))]), times)
        count = int(np.sum(longer.start_s + times.dwell_s <= 60 * minutes + 1e-6))
        if count > len(planned):
            planned = schedule(cells, longer.cells[:count], times)
        return self.evaluated(positions, planned, fits=bool(planned.minutes <= minutes + 1e-6))


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
