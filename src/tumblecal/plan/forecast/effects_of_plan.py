"""What the diagnosis will have to decide with: a schedule measured by an instrument without errors, and its list of causes.

The decisions are made in the residual space, which the nominal model does not reach: an effect adds its signal there, and the
noise is white. Causes, weights and thresholds are those of the diagnosis itself. An undetected effect leaves an error in use,
since the parameters absorb a part of it.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Place, State, Where, settings
from tumblecal.chain.head_ability import SlowNoise
from tumblecal.chain.rig import Rig
from tumblecal.diagnosis.causes.pool import Pool, pooled
from tumblecal.diagnosis.detection.alternatives import Alternatives, alternatives
from tumblecal.diagnosis.detection.detect import weight_of
from tumblecal.diagnosis.detection.null_curve import threshold
from tumblecal.diagnosis.priors import SIZE
from tumblecal.effects import Catalogue
from tumblecal.effects.catalogue import entry
from tumblecal.estimation.identifiability import RANK_TOLERANCE
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.slow_noise import with_slow_noise
from tumblecal.estimation.visits import with_repeatability
from tumblecal.full_model.full_model import FullModel, model_of
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.tangent import Tangent, tangent
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.showing import brief
from tumblecal.ground.units import factor
from tumblecal.plan.cells import Cells
from tumblecal.plan.responses import stated_noise
from tumblecal.simulation.inject import injected_links


# Attitudes of use: the directions of gravity to the corners, edges and faces of a cube.
_ATTITUDES = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float)
ATTITUDES = _ATTITUDES / np.linalg.norm(_ATTITUDES, axis=1, keepdims=True)


@dataclass(frozen=True)
class EffectsOfPlan:
    """A schedule linearised without errors, and the causes among which its diagnosis will choose.

    - `at`: the linearised problem. `entries`: the catalogue.
    """

    __repr__ = brief

    at: Tangent
    entries: Catalogue

    @cached_property
    def pool(self) -> Pool:
        """The causes."""
        return pooled(self.at, 1.0)

    @cached_property
    def alternatives(self) -> Alternatives:
        """Other noise, and lack of fit."""
        return alternatives(self.at, self.pool.effect_blocks)

    @cached_property
    def threshold(self) -> float:
        """Test statistic from which on the data are not adequate."""
        weight = weight_of(self.pool, self.alternatives)
        return threshold(SIZE, self.pool.dof, self.at.problem.known, weight)

    @property
    def model(self) -> FullModel:
        """The nominal chain with every effect that the schedule allows."""
        return self.at.model

    @property
    def ids(self) -> tuple[str, ...]:
        """The effects that the schedule allows."""
        return tuple(dict.fromkeys(slot.id for slot in self.model.slots))

    def slot(self, id: str) -> Slot:
        """The first link of an effect.

        **Raises:** `InputError` for an effect that the catalogue lacks or that this schedule cannot test.
        """
        found = next((slot for slot in self.model.slots if slot.id == id), None)
        if found is None:
            entry(self.entries, id)
            on_data = "it acts on the data or on the noise, not on the readings of a position"
            raise InputError(f"{id}: a plan cannot be designed for it: {self.model.not_testable.get(id, on_data)}")
        return found

    def unit_steps(self, slot: Slot) -> Float[np.ndarray, " columns"]:
        """Coefficients of an effect of size 1 in its unit, each of this size, in scales of the model."""
        effect, units = self.entries[slot.id], dict(zip(slot.all_columns, slot.units, strict=True))
        sizes = [factor(effect.unit, units[k]) if effect.shows(units[k]) else 0.0 for k in slot.columns]
        return np.array(sizes) / self.model.scales[list(slot.columns)]

    def signals(self, slot: Slot) -> Float[np.ndarray, "positions 3 columns"]:
        """White signals of an effect's coefficients at each position, each in its scale."""
        count = len(self.at.problem.readings)
        return self.at.jacobian[: 3 * count, list(slot.columns)].reshape(count, 3, -1)

    def signal(self, id: str) -> Float[np.ndarray, " rows"]:
        """White signal of an effect of size 1 in its unit, every coefficient of this size."""
        slot = self.slot(id)
        return self.at.jacobian[:, list(slot.columns)] @ self.unit_steps(slot)

    def shown(self, id: str) -> Float[np.ndarray, " nu"]:
        """What the nominal model leaves of it."""
        return self.at.basis.T @ self.signal(id)

    def visible(self, id: str) -> float:
        """Share of the signal of an effect that the nominal parameters do not absorb."""
        return float(np.linalg.norm(self.shown(id)) / max(np.linalg.norm(self.signal(id)), 1e-300))

    @cached_property
    def absorbed(self) -> Float[np.ndarray, "nominal rows"]:
        """Changes of the nominal parameters, in scales of the model, by a white signal."""
        return np.linalg.pinv(self.at.jacobian[:, : self.model.nominal], rcond=RANK_TOLERANCE)

    def error_in_use(self, id: str) -> Float[np.ndarray, " rows"]:
        """Error of the corrected force, g, at the attitudes of use, by an effect of size 1 in its unit that the calibration of
        the plan does not know."""
        own = effect_in_use(self.entries, self.slot(id), of_use(self.at.problem.where))
        absorbed = self.model.scales[: self.model.nominal] * (self.absorbed @ self.signal(id))
        return own - sensor_rows(self.model.names) @ absorbed

    def block(self, number: int) -> Float[np.ndarray, "nu rank"]:
        """Orthonormal basis of the signal of a cause with coefficients."""
        block = self.pool.causes[number].block
        assert block is not None  # faults have an offset instead
        return block

    def causes(self, id: str) -> Int[np.ndarray, " own"]:
        """Numbers of an effect among the causes; several for one with several starts, none for one that does not show."""
        return np.array([k for k in self.pool.effects.tolist() if self.pool.labels[k] == id], int)


def effects_of_plan(rig: Rig, entries: Catalogue, like: FullModel | None = None) -> EffectsOfPlan:
    """The effects at the positions of a rig's plan, by its chain with its priors; slow noise as a noise model states it.

    **Arguments:**

    - `rig`: of `planned_rig` for the positions and times of a schedule.
    - `like`: the model of another schedule of the rig, as of `model_of`.

    **Raises:** `InputError` for a rig whose noise is not stated.
    """
    sd, where, ability = stated_noise(rig), rig.where, rig.ability
    chain = rig.chain(where)
    model = model_of(chain, where, entries, like)
    priors: Priors = {name: (0.0, sd) for name, (_, sd) in rig.priors.items()}
    if ability is not None:
        priors = with_repeatability(priors, ability.repeatability, chain, where)
    readings = model.evaluate(where, model.start).predicted
    problem = Problem.from_arrays(chain, where, readings, noise_sd=sd, priors=priors)
    return EffectsOfPlan(tangent(model, with_slow_noise(problem, ability), model.start), entries)


def effects_of_cells(
    rig: Rig, cells: Cells, entries: Catalogue, seconds: float, like: FullModel | None = None
) -> EffectsOfPlan:
    """The effects at some cells of a rig's head, under white noise, as if these were measured in their order in a time; other
    arguments as of `effects_of_plan`."""
    plan = cells.plan(tuple(map(str, range(len(cells)))), np.linspace(0.0, seconds, len(cells)))
    ability = rig.ability and replace(rig.ability, slow_noise=SlowNoise())
    return effects_of_plan(replace(rig, plan=plan, ability=ability), entries, like)


def sensor_rows(names: tuple[str, ...]) -> Float[np.ndarray, "rows parameters"]:
    """Readings, g, by parameters of the sensor (base units), axis by axis for each of `ATTITUDES`; others add nothing."""
    rows = np.zeros((len(ATTITUDES), 3, len(names)))
    for column, name in enumerate(names):
        leaf, _, own = name.partition("_")
        if leaf in ("bias", "dK") and own in AXES:
            axis = AXES.index(own)
            rows[:, axis, column] = 1.0 if leaf == "bias" else ATTITUDES[:, axis]
        elif leaf == "gamma" and own.isdigit():
            rows[:, int(own[0]) - 1, column] = ATTITUDES[:, int(own[1]) - 1]
    return rows.reshape(-1, len(names))


def of_use(plan: Where) -> Where:
    """The settings of use, at the mean time and temperature of a measurement; the first one begins it, as effects of time count
    from there."""
    time, degc, zero = plan.time_s, plan.temperature_degc, np.zeros(len(ATTITUDES) + 1)
    if time is not None:
        time = np.append(np.min(time), zero[1:] + np.mean(time))
    return settings(zero, zero, time_s=time, temperature_degc=None if degc is None else zero + np.mean(degc))


def effect_in_use(entries: Catalogue, slot: Slot, use: Where) -> Float[np.ndarray, " rows"]:
    """What an effect of size 1 in its unit adds to the readings at the attitudes of use, axis by axis for each attitude; 0 for
    one of the head, of the path or of settings."""
    link = slot.links[0]
    if link.place != Place.READING or link.looks_back or slot.shape or entries[slot.id].lacking(use):
        return np.zeros(ATTITUDES.size)
    (link,) = injected_links({slot.id: [1.0]}, use, entries)
    x, y, z = (jnp.asarray(np.append(part[0], part)) for part in ATTITUDES.T)
    zero = jnp.zeros_like(x)
    reading = link(State(zero, zero, (x, y, z), (zero, zero, zero)), use).reading
    return np.stack([np.broadcast_to(np.asarray(part), zero.shape)[1:] for part in reading], axis=1).ravel()
