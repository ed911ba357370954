"""The improvement on rows that took no part: the model chosen and fitted without them, and their errors with and without it."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from tumblecal.capture.thermal.thermal_table import ThermalTable
from tumblecal.ground.errors import InputError
from tumblecal.thermal.choice import Stated, chosen_model
from tumblecal.thermal.design import estimate
from tumblecal.thermal.model import ThermalModel, directions_of
from tumblecal.thermal.orders import folds_of


@dataclass(frozen=True)
class HeldOut:
    """Errors of readings that took no part in choice and fit, root mean square over rows and axes, mg.

    - `label`: the rows. `rows`: their number. `before_mg`: with parameters at the reference temperature. `after_mg`: with
      parameters that follow temperature. `noise_mg`: standard deviation of their means.
    """

    label: str
    rows: int
    before_mg: float
    after_mg: float
    noise_mg: float


def held_out(table: ThermalTable, stated: Stated) -> tuple[HeldOut, ...]:
    """The improvement on each branch or soak, or on each part of the temperatures, that is left out in turn.

    A part that cannot be left out, because the rest determines no model of it, is omitted.
    """
    reached = np.asarray(table.reached_by, float)
    found = []
    for apart in folds_of(table.attitude, reached, table.temperature_degc):
        try:
            found.append(_of_rows(table, apart, stated))
        except InputError:
            continue
    return tuple(entry for entry in found if entry is not None)


def _of_rows(table: ThermalTable, apart: Bool[np.ndarray, " rows"], stated: Stated) -> HeldOut | None:
    rest = table.rows(~apart)
    low, high = rest.range_degc
    # The functions are not extrapolated; an attitude that is not in the rest has no estimate.
    inside = (table.temperature_degc >= low) & (table.temperature_degc <= high)
    known = np.array([name in set(rest.attitude) for name in table.attitude])
    apart = apart & inside & known
    if not apart.any():
        return None
    model = chosen_model(rest, stated).model
    model = replace(model, signals=(), lag_s=0.0, directions=directions_of(rest))
    values = dict(zip(model.chain.names, estimate(model).tolist(), strict=True))
    constant = {name: value for name, value in values.items() if "_T_" not in name}
    rows = table.rows(apart)
    errors = [
        _errors(replace(model, table=rows, functions=f), v) for f, v in (({}, constant), (model.functions, values))
    ]
    before, after = (1e3 * float(np.sqrt(np.mean(error**2))) for error in errors)
    noise = 1e3 * float(np.sqrt(np.mean(rows.sd**2)))
    return HeldOut(_label(rows, table), len(rows), before, after, noise)


def _errors(model: ThermalModel, values: dict[str, float]) -> np.ndarray:
    chain = model.chain
    chain = chain.named({name: value for name, value in values.items() if name in set(chain.names)})
    return np.asarray(chain(model.where)) - model.table.readings


def _label(rows: ThermalTable, table: ThermalTable) -> str:
    low, high = rows.range_degc
    where = f"{low:.1f} to {high:.1f} degC"
    directions = {1: "rising", -1: "falling"}
    present = set(np.asarray(rows.reached_by).tolist())
    if (
        len(present) == 1
        and present != set(np.asarray(table.reached_by).tolist())
        and (sign := present.pop()) in directions
    ):
        return f"{directions[sign]} temperature, {where}"
    return where
