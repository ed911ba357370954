"""Files of a temperature calibration: thermal.json, the table of bins, and the parameters over temperature."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import polars as pl

from tumblecal.data.calibration import write_calibration
from tumblecal.data.calibration_table import COLUMNS, calibration_table
from tumblecal.ground.atomic import write_text
from tumblecal.ground.formula_cells import all_as_text
from tumblecal.ground.json_file import json_text
from tumblecal.report.thermal_words import thermal_lines
from tumblecal.thermal.result import ThermalResult


SCHEMA = "tumblecal.thermal/1"
# The lookup table has a row for each degree of a range up to this many; more are too many for a device.
_ROWS = 101


def write_thermal(folder: Path, result: ThermalResult) -> list[str]:
    """Write the result without its page; returns the names of the files."""
    write_calibration(folder / "calibration.json", result.calibration)
    write_text(folder / "thermal.json", json_text(thermal_record(result)))
    _write_columns(folder / "bins.csv", result.table.frame, result.table.comments)
    names = ["calibration.json", "thermal.json", "bins.csv"]
    if result.curves is not None:
        rows = parameter_rows(result)
        _write_columns(folder / "parameters.csv", pl.DataFrame(rows).select(COLUMNS))
        names.append("parameters.csv")
    return names


def parameter_rows(result: ThermalResult) -> list[dict[str, float]]:
    """The sensor's parameters with standard uncertainties over the measured range."""
    low, high = result.table.range_degc
    count = int(min(_ROWS, max(11, round(high - low) + 1)))
    return calibration_table(result.calibration, np.linspace(low, high, count).tolist())


def thermal_record(result: ThermalResult) -> dict[str, Any]:
    """The result as plain numbers, lists and texts."""
    choice = result.choice
    return {
        "schema": SCHEMA,
        "source": result.table.source,
        "serial_number": result.calibration.serial_number,
        "use": result.calibration.use.record(),
        "reference_degc": result.reference_degc,
        "range_degc": list(result.table.range_degc),
        "rows": len(result.table),
        "attitudes": len(result.table.attitudes),
        "attitudes_known": result.table.known_attitudes,
        "orders": {leaf: choice.orders.get(leaf, 0) for leaf in choice.highest},
        "knots_degc": {leaf: list(each.knots_degc) for leaf, each in choice.model.functions.items() if each.knots_degc},
        "highest_orders": dict(choice.highest),
        "dropped": list(choice.dropped),
        "not_determined": {
            "at_reference": list(result.undetermined),
            "change": list(choice.inseparable),
            "combinations": list(result.combinations),
        },
        "information_criterion": {"chosen": choice.criterion, "constant": choice.constant_criterion},
        "noise_factor": result.noise_factor,
        "not_separated_from": list(choice.unseparated),
        "coefficients": _coefficients(result),
        "signals": [
            {
                "name": signal.name,
                "unit": signal.unit,
                "coefficients": dict(zip(signal.components, signal.coefficients.tolist(), strict=True)),
                "sd": dict(zip(signal.components, signal.sd.tolist(), strict=True)),
                "half_width_g": dict(zip("xyz", signal.half_width.tolist(), strict=True)),
                "not_separated_from": list(signal.not_separated),
            }
            for signal in result.signals
        ],
        "held_out": [asdict(part) for part in result.held_out],
        "words": list(thermal_lines(result)),
    }


def _coefficients(result: ThermalResult) -> dict[str, dict[str, Any]]:
    if (curves := result.curves) is None:
        return {}
    sd = np.sqrt(np.diag(curves.covariance))[9:]
    names = [name for curve in curves.curves for name in curve.coefficient_names]
    units = [unit for curve in curves.curves for unit in curve.units]
    values = np.concatenate([curve.coefficients for curve in curves.curves])
    return {
        name: {"value": value, "sd": size, "unit": unit}
        for name, value, size, unit in zip(names, values.tolist(), sd.tolist(), units, strict=True)
    }


def _write_columns(path: Path, table: pl.DataFrame, comments: Mapping[str, str] = MappingProxyType({})) -> None:
    lines = "".join(f"# {key}: {text}\n" for key, text in comments.items())
    write_text(path, lines + table.with_columns(all_as_text()).write_csv())
