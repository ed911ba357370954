"""The improvement on held-out rows: the model is chosen and fitted without them; their errors with and without it."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from tumblecal.ground.soaks import soaks
from tumblecal.recordings.thermal.thermal_table import ThermalTable
from tumblecal.thermal.choice import Choice, selected
from tumblecal.thermal.orders import folds_of, predictable, temperatures_outside, without_signals
from tumblecal.thermal.signals import NAMES


@dataclass(frozen=True)
class HeldOut:
    """Errors of readings outside choice and fit, root mean square over rows and axes, mg.

    - `label`: the rows. `rows`: their number. `before_mg`: with parameters at the reference temperature. `after_mg`: with
      parameters that follow temperature. `noise_mg`: standard deviation of their means.
    """

    label: str
    rows: int
    before_mg: float
    after_mg: float
    noise_mg: float


def held_out(choice: Choice) -> tuple[HeldOut, ...]:
    """The improvement on each branch or soak, or on each part of the temperatures, that is left out in turn.

    The linearised design of all rows serves every part. Functions are not extrapolated, and an attitude that is not in the rest
    has no estimate: such rows are omitted.
    """
    found = [_of_rows(choice, apart) for apart in folds_of(choice.model.table)]
    return tuple(entry for entry in found if entry is not None)


def between_recordings(choice: Choice) -> tuple[HeldOut, ...]:
    """How well the other recordings predict each one at temperatures outside theirs, in the attitudes that they have too.

    The functions are extrapolated, as nowhere else: the error is that of a calibration that is used outside its range.
    """
    table, found = choice.model.table, list[HeldOut]()
    clocks, labels, degc = np.array(table.clock), np.array(table.attitude), table.temperature_degc
    for clock in dict.fromkeys(table.clock):
        apart = clocks == clock
        if apart.all():
            continue
        low, high = degc[~apart].min(), degc[~apart].max()
        taken = apart & np.isin(labels, labels[~apart]) & ((degc < low) | (degc > high))
        part = _of_rows(choice, apart, taken)
        if part is not None:
            words = f"{clock}, {part.label}, from the other recordings, {low:.1f} to {high:.1f} degC"
            found.append(replace(part, label=words))
    return tuple(found)


def _of_rows(
    choice: Choice, apart: Bool[np.ndarray, " rows"], taken: Bool[np.ndarray, " rows"] | None = None
) -> HeldOut | None:
    table, design = choice.model.table, choice.design
    rest = table.rows(~apart)
    if taken is None:
        taken, temperatures = predictable(table, apart), temperatures_outside(table, apart)
    else:
        temperatures = len(soaks(rest.temperature_degc))
    highest = {leaf: min(order, temperatures - 1) for leaf, order in choice.highest.items()}
    if not taken.any() or min(highest.values(), default=0) < 1:
        return None
    fitted, rows = design.part(~apart), design.part(taken)
    chosen = selected(fitted, rest, highest, choice.forced).confirmed
    orders = {name: order for name, order in chosen.items() if name not in NAMES}
    coefficients = without_signals(fitted, chosen).coefficients(orders)
    at_reference = np.where(np.arange(len(coefficients)) < design.constant.shape[1], coefficients, 0.0)
    held = table.rows(taken)
    before, after = (
        1e3 * float(np.sqrt(np.mean(((rows.values - rows.predicted(orders, each)) * held.sd.ravel()) ** 2)))
        for each in (at_reference, coefficients)
    )
    return HeldOut(_label(held, table), len(held), before, after, 1e3 * float(np.sqrt(np.mean(held.sd**2))))


def _label(rows: ThermalTable, table: ThermalTable) -> str:
    low, high = (f"{end:.1f}" for end in rows.range_degc)
    where = f"{low} degC" if low == high else f"{low} to {high} degC"
    directions, present = {1: "rising", -1: "falling"}, set(rows.reached_by.tolist())
    if (
        len(present) == 1
        and directions.keys() <= set(table.reached_by.tolist())
        and (sign := present.pop()) in directions
    ):
        return f"{directions[sign]} temperature, {where}"
    return where
