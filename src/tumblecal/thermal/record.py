"""Files of a temperature calibration: thermal.json, the table of bins, and the parameters over temperature."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import polars as pl

from tumblecal.data.calibration import write_calibration
from tumblecal.data.calibration_table import calibration_table
from tumblecal.data.calibration_use import Use
from tumblecal.ground.atomic import write_text
from tumblecal.ground.axes import AXES
from tumblecal.ground.plain_text import all_as_text
from tumblecal.ground.record import Count, Estimate, ResultRecord, at, by_name
from tumblecal.thermal.held_out import HeldOut
from tumblecal.thermal.result import ThermalResult


# The lookup table has a row for each degree of a range up to this many; more are too many for a device.
_ROWS = 101


class NotDetermined(ResultRecord):
    """Leaves that the attitudes do not determine, and combinations that they determine."""

    at_reference: list[str] = at("undetermined")
    change: list[str] = at("choice.inseparable")
    combinations: list[str]


class InformationCriterion(ResultRecord):
    """Values of the information criterion, of the model and of parameters that do not depend on temperature."""

    chosen: float = at("criterion")
    constant: float = at("constant_criterion")


class SignalRecord(ResultRecord):
    """`FoundSignal`."""

    name: str
    unit: str
    coefficients: dict[str, float]
    sd: dict[str, float]
    half_width_g: Annotated[dict[str, float], by_name(AXES)]
    not_separated_from: list[str]


class ThermalRecord(ResultRecord):
    """`thermal.json`: a `ThermalResult`; `words`: the verdict."""

    schema_: Literal["tumblecal.thermal/1"] = "tumblecal.thermal/1"
    source: str = at("table.source")
    serial_number: str | None = at("calibration.serial_number")
    use: Use = at("calibration.use")
    reference_degc: float
    range_degc: tuple[float, float] = at("table.range_degc")
    rows: Count = at("table")
    attitudes: Count = at("table.attitudes")
    attitudes_known: bool = at("table.known_attitudes")
    orders: dict[str, int] = at("choice.orders_of_leaves")
    knots_degc: dict[str, list[float]] = at("choice.model.knots_degc")
    highest_orders: dict[str, int] = at("choice.highest")
    dropped: list[str] = at("choice.dropped")
    not_determined: NotDetermined = at("result")
    information_criterion: InformationCriterion = at("choice")
    noise_factor: float
    not_separated_from: list[str] = at("choice.unseparated")
    coefficients: dict[str, Estimate]
    signals: list[SignalRecord]
    held_out: list[HeldOut]
    words: list[str]


def write_result(folder: Path, result: ThermalResult, words: Sequence[str]) -> list[str]:
    """Write the result without its page; `words`: the verdict. Returns the names of the files."""
    write_calibration(folder / "calibration.json", result.calibration)
    ThermalRecord.of(result, words=words).write(folder / "thermal.json")
    comments = "".join(f"# {key}: {text}\n" for key, text in result.table.comments.items())
    write_text(folder / "bins.csv", comments + result.table.frame.with_columns(all_as_text()).write_csv())
    names = ["calibration.json", "thermal.json", "bins.csv"]
    if result.curves is not None:
        low, high = result.table.range_degc
        degc = np.linspace(low, high, int(min(_ROWS, max(11, round(high - low) + 1))))
        rows = calibration_table(result.calibration, degc.tolist())
        write_text(folder / "parameters.csv", pl.DataFrame(rows).write_csv())
        names.append("parameters.csv")
    return names
