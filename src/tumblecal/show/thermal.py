"""A temperature calibration for people: its words, its tables on a terminal, and its page."""

from pathlib import Path

import numpy as np
from rich.console import Console

from tumblecal.data.sensor_parameters import SENSOR, UNITS, leaf_of
from tumblecal.ground.numbers_shown import rounded
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.ground.units import shown
from tumblecal.show.figures.thermal import FIGURES
from tumblecal.show.narrow import print_table
from tumblecal.show.page import write_page
from tumblecal.show.tables import Table
from tumblecal.show.words import Words, words_of
from tumblecal.thermal.estimates import known_at_reference, parameters_at, sd_at, varying
from tumblecal.thermal.model import LEAVES
from tumblecal.thermal.record import write_result
from tumblecal.thermal.result import ThermalResult, measured_range
from tumblecal.thermal.usual_sizes import HISTORY


def words_of_thermal(result: ThermalResult, folder: Path) -> Words:
    """The words of a temperature calibration; `folder`: of its files, for suggested commands."""
    table, choice, sensor = result.table, result.choice, result.calibration.sensor.of(SENSOR)
    low, high = table.range_degc
    degc = sorted({float(np.ceil(low)), result.reference_degc, float(np.floor(high))})
    branches = {(table.clock[row], table.branch[row]) for row in np.flatnonzero(table.reached_by)}
    return words_of(
        "thermal",
        r=result,
        leaves=LEAVES,
        file=Path(table.source).name,
        total=total_errors(result),
        undetermined=() if choice.model.fixed else result.undetermined,
        history=f"{100 * HISTORY:g}",
        never_returns=0 < len(branches) == len({clock for clock, _ in branches}),
        span=measured_range(table),
        lowest=min((choice.highest[leaf] for leaf in choice.highest if leaf not in choice.forced), default=0),
        diagnose=suggested("diagnose", folder / "bins.csv", less=EVERY),
        folder=folder,
        calibration=folder / "calibration.json",
        sensor=[] if result.calibration.use.refused else zip(SENSOR, sensor.values, sensor.sd, strict=True),
        measured=[name for name in SENSOR if leaf_of(name) in choice.model.free],
        units=UNITS,
        scaled=_scaled,
        degc=",".join(f"{each:g}" for each in degc),
    )


def total_errors(result: ThermalResult) -> list[float]:
    """Errors of all held-out rows before and after, and their noise, mg; none without held-out rows."""
    if not result.held_out:
        return []
    rows = np.array([part.rows for part in result.held_out], float)
    sizes = np.array([(part.before_mg, part.after_mg, part.noise_mg) for part in result.held_out])
    return np.sqrt(rows @ sizes**2 / np.sum(rows)).tolist()


def _scaled(value: float, u: float) -> list[str]:
    """A value and its uncertainty with a common power of ten, if they are small."""
    power = int(np.floor(np.log10(max(abs(value), u)))) if max(abs(value), u) > 0 else 0
    if power >= -2:
        return rounded(value, u)
    return [f"{digits}e{power}" for digits in rounded(value / 10.0**power, u / 10.0**power)]


def temperature_table(result: ThermalResult) -> Table:
    """Parameters that follow temperature, with standard uncertainties, at the ends of the range."""
    degc = np.array(result.table.range_degc)
    values, sd = parameters_at(result, degc), sd_at(result, degc)
    rows = []
    for name in varying(result):
        k, (unit, factor) = SENSOR.index(name), shown(UNITS[name])
        cells = [cell for end in (0, 1) for cell in rounded(values[end, k] * factor, sd[end, k] * factor)]
        rows.append([name if known_at_reference(result, name) else f"change of {name}", unit, *cells])
    header = ["parameter", "unit", *(cell for end in degc for cell in (f"at {end:.1f} degC", "u"))]
    return Table(header, rows)


def write_thermal(folder: Path, result: ThermalResult, words: Words) -> None:
    """Write all files of a temperature calibration."""
    write_result(folder, result, words.verdict.words().splitlines())
    tables = {} if result.curves is None else {"temperature": temperature_table(result)}
    write_page(folder / "thermal.html", words, FIGURES, result, tables=tables)


def print_thermal(words: Words) -> None:
    """Print the parameters of a temperature calibration."""
    for name in ("reference", "coefficients"):
        if table := words.table(name):
            print()
            print_table(Console(), table)
