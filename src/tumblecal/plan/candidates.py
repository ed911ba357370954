"""All positions of a design: those that the head can measure, those measured already, and those of plans to compare."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.rig import Rig
from tumblecal.ground.errors import InputError
from tumblecal.ground.soaks import ONE_TEMPERATURE_DEGC, soak_numbers
from tumblecal.plan.cells import Cells, Positions, cells_of
from tumblecal.plan.criterion import attitudes_in_use
from tumblecal.plan.forecast.record import EffectForecast
from tumblecal.plan.information import Uncertainties, uncertainties
from tumblecal.plan.responses import Responses, responses_of
from tumblecal.plan.schedule import Schedule, schedule


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
    - `measured`: cells of the positions that are measured already. `others`: of each other plan.
    """

    responses: Responses
    use: Responses
    ability: HeadAbility
    of_head: int
    measured: Int[np.ndarray, " measured"]
    others: tuple[Int[np.ndarray, " positions"], ...]

    def scheduled(self, order: Int[np.ndarray, " positions"]) -> Schedule:
        """The schedule of some of these cells."""
        return schedule(self.responses.cells, order, self.ability.times)

    @property
    def before(self) -> tuple[float, tuple[int, int]]:
        """Duration of the positions that are measured already, min, and their visits of pitch settings and of mountings."""
        if not len(self.measured):
            return 0.0, (0, 0)
        done = self.scheduled(self.measured)
        return done.minutes, (1 + int(done.pitch_visit[-1]), 1 + int(done.mount_visit[-1]))

    def evaluated(self, positions: Positions, planned: Schedule, *, fits: bool = True) -> Evaluated:
        """A schedule of these cells with its uncertainties."""
        found = uncertainties(self.responses, planned, self.ability)
        of_force = np.sqrt(np.vecdot(self.use.columns @ found.covariance, self.use.columns))
        return Evaluated(positions, planned, found, of_force, fits)

    def in_time(self, positions: Positions, once: Int[np.ndarray, " positions"], minutes: float) -> Evaluated:
        """Positions of each mounting and temperature repeated, without remounting, until the time is used: the last mounting
        gets the rest."""
        *blocks, last = np.split(once, 1 + np.flatnonzero(np.diff(self.responses.cells.sitting[once])))
        passes, limit_s = 1, 60 * minutes + 1e-6

        def repeated(passes: int, of_last: int) -> Schedule:
            return self.scheduled(
                np.concatenate([*(np.tile(block, passes) for block in blocks), np.tile(last, of_last)])
            )

        while repeated(passes + 1, passes + 1).end_s <= limit_s:
            passes += 1
        longer = repeated(passes, 2 * passes + len(once))
        count = np.count_nonzero(longer.start_s + self.ability.times.dwell_s <= limit_s)
        planned = self.scheduled(longer.cells[: max(count, passes * len(once))])
        return self.evaluated(positions, planned, fits=bool(planned.end_s <= limit_s))


def candidates_of(
    rig: Rig, ability: HeadAbility, measured: Positions | None, others: Sequence[Positions]
) -> Candidates:
    """The positions of a head, of a measurement and of other plans.

    **Raises:** `InputError` for a rig with effects of time.
    """
    listed = [*([] if measured is None else [measured]), *others]
    parts = [cells_of(ability), *(_in_chamber(each.cells, ability) for each in listed), attitudes_in_use(ability)]
    try:
        responses = responses_of(rig, parts[0].joined(*parts[1:]))
    except InputError as error:
        if not (rig.effects or rig.temperature.leaves):
            raise
        raise InputError(
            f"{rig.source}: {str(error).removeprefix(f'{rig.source}: ')} (a plan is designed for settings without times): "
            "remove such effects from chain.effects, and state the temperatures of a chamber in [head] temperatures_degc"
        ) from error
    every = np.arange(len(responses.cells))
    _, *numbers, used = np.split(every, np.cumsum([len(each) for each in parts[:-1]]))
    known = np.zeros(0, int) if measured is None else numbers.pop(0)
    planned = responses.chosen(every[: -len(used)])
    return Candidates(planned, responses.chosen(used), ability, len(parts[0]), known, tuple(numbers))


def _in_chamber(cells: Cells, ability: HeadAbility) -> Cells:
    """Cells at the temperatures of the chamber: the mean of each soak, or the temperature of the chamber that it is equal to;
    its middle one if no temperature is stated."""
    chamber, degc = np.array(ability.temperatures_degc), cells.temperature_degc
    if not len(chamber):
        return replace(cells, temperature_degc=None)
    if degc is None:
        return replace(cells, temperature_degc=np.full(len(cells), float(np.median(chamber))))
    if (number := soak_numbers(degc)) is not None:
        degc = (np.bincount(number, degc) / np.bincount(number))[number]
    nearest = chamber[np.argmin(np.abs(degc[:, None] - chamber), axis=1)]
    return replace(cells, temperature_degc=np.where(np.abs(degc - nearest) <= ONE_TEMPERATURE_DEGC, nearest, degc))
