"""Errors in use that effects leave in a calibration which does not know them: the parameters absorb a part of each."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from tumblecal.chain import Place, State, Where, settings
from tumblecal.effects import Catalogue
from tumblecal.full_model.layout import Slot
from tumblecal.ground.axes import AXES
from tumblecal.plan.forecast.effects_of_plan import EffectsOfPlan
from tumblecal.simulation.inject import injected_links


# Attitudes of use: the directions of gravity to the corners, edges and faces of a cube.
_ATTITUDES = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float)
ATTITUDES = _ATTITUDES / np.linalg.norm(_ATTITUDES, axis=1, keepdims=True)


def sensor_rows(names: tuple[str, ...]) -> Float[np.ndarray, "rows parameters"]:
    """Readings, g, by parameters of the sensor (base units), axis by axis for each of `ATTITUDES`; others add nothing."""
    rows = np.zeros((len(ATTITUDES), 3, len(names)))
    for column, name in enumerate(names):
        leaf, _, own = name.partition("_")
        if leaf == "bias" and own in AXES:
            rows[:, AXES.index(own), column] = 1.0
        elif leaf == "dK" and own in AXES:
            rows[:, AXES.index(own), column] = ATTITUDES[:, AXES.index(own)]
        elif leaf == "gamma" and own in ("21", "31", "32"):
            rows[:, int(own[0]) - 1, column] = ATTITUDES[:, int(own[1]) - 1]
    return rows.reshape(-1, len(names))


def of_use(plan: Where) -> Where:
    """The settings of use, at the mean time and temperature of a measurement; the first one begins it, as effects of time count
    from there."""
    time, degc, count = plan.time_s, plan.temperature_degc, len(ATTITUDES)
    return settings(
        np.zeros(count + 1),
        np.zeros(count + 1),
        time_s=None if time is None else np.append(np.min(time), np.full(count, np.mean(time))),
        temperature_degc=None if degc is None else np.full(count + 1, np.mean(degc)),
    )


def effect_in_use(entries: Catalogue, slot: Slot, use: Where) -> Float[np.ndarray, " rows"]:
    """What an effect of size 1 in its unit adds to the readings at the attitudes of use, axis by axis for each attitude; 0 for
    one of the head, of the path or of settings."""
    link, added = slot.links[0], np.zeros((len(ATTITUDES), 3))
    if link.place != Place.READING or link.looks_back or slot.shape or entries[slot.id].lacking(use):
        return added.ravel()
    (link,) = injected_links({slot.id: [1.0]}, use, entries)
    x, y, z = (jnp.asarray(np.append(part[0], part)) for part in ATTITUDES.T)
    zero = jnp.zeros_like(x)
    reading = link(State(zero, zero, (x, y, z), (zero, zero, zero)), use).reading
    return np.stack([np.broadcast_to(np.asarray(part), zero.shape)[1:] for part in reading], axis=1).ravel()


def error_in_use(of: EffectsOfPlan, id: str) -> Float[np.ndarray, " rows"]:
    """Error of the corrected force, g, at the attitudes of use, by an effect of size 1 in its unit that the calibration of a
    plan does not know."""
    own = effect_in_use(of.entries, of.slot(id), of_use(of.at.problem.where))
    absorbed = of.model.scales[: of.model.nominal] * (of.absorbed @ of.signal(id))
    return own - sensor_rows(of.model.names) @ absorbed
