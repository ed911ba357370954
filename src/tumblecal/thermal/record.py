"""Files of a temperature calibration: thermal.json, the table of bins, and the parameters over temperature."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from tumblecal.data.calibration import write_calibration
from tumblecal.data.calibration_table import calibration_table
from tumblecal.ground.atomic import write_text
from tumblecal.ground.formula_cells import all_as_text
from tumblecal.ground.json_file import json_text
from tumblecal.thermal.result import ThermalResult


SCHEMA = "tumblecal.thermal/1"
# The lookup table has a row for each degree of a range up to this many; more are too many for a device.
_ROWS = 101


def write_thermal(folder: Path, result: ThermalResult, words: Sequence[str]) -> list[str]:
    """Write the result without its page; `words`: the verdict. Returns the names of the files."""
    write_calibration(folder / "calibration.json", result.calibration)
    write_text(folder / "thermal.json", json_text(thermal_record(result, words)))
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


def thermal_record(result: ThermalResult, words: Sequence[str]) -> dict[str, Any]:
    """The result as plain numbers, lists and texts."""
    choice = result.choice
    return {
        "schema": SCHEMA,
        "source": result.table.source,
        "serial_number": result.calibration.serial_number,
        "use": result.calibration.use.record(),
        "reference_degc": result.reference_degc,
        "range_degc": result.table.range_degc,
        "rows": len(result.table),
        "attitudes": len(result.table.attitudes),
        "attitudes_known": result.table.known_attitudes,
        "orders": {leaf: choice.orders.get(leaf, 0) for leaf in choice.highest},
        "knots_degc": {leaf: each.knots_degc for leaf, each in choice.model.functions.items() if each.knots_degc},
        "highest_orders": choice.highest,
        "dropped": choice.dropped,
        "not_determined": {
            "at_reference": result.undetermined,
            "change": choice.inseparable,
            "combinations": result.combinations,
        },
        "information_criterion": {"chosen": choice.criterion, "constant": choice.constant_criterion},
        "noise_factor": result.noise_factor,
        "not_separated_from": choice.unseparated,
        "coefficients": {
            name: {"value": value, "sd": sd, "unit": unit} for name, value, sd, unit in result.coefficients
        },
        "signals": [
            {
                "name": signal.name,
                "unit": signal.unit,
                "coefficients": dict(zip(signal.components, signal.coefficients.tolist(), strict=True)),
                "sd": dict(zip(signal.components, signal.sd.tolist(), strict=True)),
                "half_width_g": dict(zip("xyz", signal.half_width.tolist(), strict=True)),
                "not_separated_from": signal.not_separated,
            }
            for signal in result.signals
        ],
        "held_out": result.held_out,
        "words": words,
    }
