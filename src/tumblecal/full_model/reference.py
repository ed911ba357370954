"""The reference conditions of the parameters: mean time, all runs and settings with equal weight, mean temperature.

In the model a drift counts from the first position, a separate bias from the first run or setting, and a temperature from 25
degC. A calibration without a term for such an effect is more accurate for the middle of the measurement. The nominal model
fits this point, and all explanations can be compared there.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tumblecal.effects.by_setting import GroupTerms
from tumblecal.effects.effect import elapsed
from tumblecal.estimation.fit import Fit
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.axes import AXES


def moved_to_reference(at: Tangent, ids: Collection[str], *, thermal: bool) -> Float[np.ndarray, "nominal full"]:
    """Contribution of each coefficient of the full vector to the nominal parameters at the reference, all in their scales. It
    is zero for effects that do not change with time, temperature, run or setting, and for those that decay within the
    measurement.

    **Arguments:**

    - `ids`: of the requested effects; those of temperature are always included.
    - `thermal`: whether effects of temperature are written as terms; their reference is then 25 degC.
    """
    nominal, thermals = at.model.nominal, [] if thermal else at.model.layout.thermal
    added, slots = np.zeros((nominal, len(at.vector))), [slot for slot in at.model.slots if slot.id in ids]
    timed = [slot for slot in slots if slot.needs == ("time_s",) and not slot.shape]
    # A bend has no one middle: parameters are those that the nominal model fits.
    bends = [column for slot in timed if slot.order > 1 for column in slot.columns]
    signals = np.hstack([at.jacobian[:, thermals] - at.varying[:, thermals], at.jacobian[:, bends]])
    added[:, [*thermals, *bends]] = _absorbed(at.jacobian[:, :nominal], signals)
    _add_drifts(at, [slot for slot in timed if slot.order < 2], added)
    for slot in slots:
        for link in slot.links:
            if isinstance(link, GroupTerms):
                _add_groups(at, slot, link, added)
    return added


def at_reference(fit: Fit, at: Tangent, added: Float[np.ndarray, "nominal full"]) -> Fit:
    """The fit with its nominal parameters at the reference; `added` as `moved_to_reference` has it."""
    scales, nominal = at.model.scales, at.model.nominal
    to, places = np.eye(len(fit.names)), {name: k for k, name in enumerate(fit.names)}
    for slot in at.model.slots:
        for name, column in zip(slot.names, slot.all_columns, strict=True):
            if name in places:
                to[:nominal, places[name]] += added[:, column] * scales[:nominal] / scales[column]
    if not np.any(to[:nominal, nominal:]):
        return fit
    return replace(
        fit, values=to @ fit.values, covariance=to @ fit.covariance @ to.T, unidentifiable=to @ fit.unidentifiable
    )


def long_lived(
    point: Tangent, slots: Sequence[Slot], added: Float[np.ndarray, "nominal full"]
) -> Float[np.ndarray, "nominal full"]:
    """`added` with the effects that die away more slowly than the measurement lasts: their end was not measured, so the
    parameters are those that the nominal model fits, in the middle.

    **Arguments:**

    - `point`: the problem linearised with the time constants as fitted. `slots`: of the effects.
    """
    time = point.problem.where.time_s
    if time is None:
        return added
    added, duration = added.copy(), np.ptp(np.asarray(time))
    for slot in slots:
        if slot.shape and np.all(point.vector[list(slot.shape)] > duration):
            columns = list(slot.columns)
            added[:, columns] = _absorbed(point.jacobian[:, : point.model.nominal], point.jacobian[:, columns])
    return added


def _add_drifts(at: Tangent, slots: Sequence[Slot], added: Float[np.ndarray, "nominal full"]) -> None:
    """Drifts: all positions but the first, from which they count, are put at the mean time; by several clocks, at that of each,
    weighted with its positions."""
    time = at.problem.where.time_s
    if not slots or time is None:
        return
    where, columns = at.problem.where, [column for slot in slots for column in slot.columns]
    time, since = np.asarray(time), np.asarray(elapsed(where))
    clock = np.asarray(where.index("clock")) if where.clocks > 1 else np.zeros(len(time), int)
    for number, first in enumerate(where.clock_starts):
        by_clock = clock == number
        steady = np.full_like(time, time[first] + np.mean(since[by_clock]))
        steady[first] = time[first]
        groups = where.groups | ({"clock": np.full_like(clock, number)} if where.clocks > 1 else {})
        jacobian = at.model.evaluate(replace(where, time_s=steady, groups=groups), at.vector).jacobian
        rows = np.delete(jacobian, first, axis=0).reshape(-1, jacobian.shape[2]) / np.median(at.problem.sd)
        # What is known of parameters counts here as in a fit: without it a direction may be determined by nothing.
        rows = np.vstack([rows, at.jacobian[at.problem.readings.size :]])
        added[:, columns] += np.mean(by_clock) * _absorbed(rows[:, : at.model.nominal], rows[:, columns])


def _add_groups(at: Tangent, slot: Slot, link: GroupTerms, added: Float[np.ndarray, "nominal full"]) -> None:
    """Biases and scale factors of runs or settings after the first: the mean over the positions."""
    names, scales, group = at.model.names, at.model.scales, np.asarray(at.problem.where.index(link.by))
    parameter = "dK" if slot.id.startswith("scale") else "bias"
    for number, column in enumerate(slot.columns):
        later, axis = divmod(number, len(link.axes))
        name = f"{parameter}_{AXES[link.axes[axis]]}"
        if name in names:
            row = names.index(name)
            added[row, column] += np.mean(group == later + 1) * scales[column] / scales[row]


def _absorbed(
    nominal: Float[np.ndarray, "rows nominal"], signals: Float[np.ndarray, "rows effects"]
) -> Float[np.ndarray, "nominal effects"]:
    """The nominal parameters that make these signals."""
    return np.linalg.pinv(nominal, rcond=1e-9) @ signals
