"""A temperature calibration for people: its words, its verdict, its tables, and `thermal.html`."""

from functools import partial
from pathlib import Path

import numpy as np

from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.ground.numbers_shown import rounded
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.ground.units import shown
from tumblecal.show.figures.thermal import FIGURES, small_figure
from tumblecal.show.page import page, write_page
from tumblecal.show.tables import Table
from tumblecal.show.verdict import Verdict
from tumblecal.show.words import Words, words_of
from tumblecal.thermal.estimates import known_at_reference, parameters_at, sd_at, varying
from tumblecal.thermal.model import LEAVES
from tumblecal.thermal.result import ThermalResult, measured_range
from tumblecal.thermal.usual_sizes import HISTORY


_TONES = {"only": "open", "not tested": "open", "no": "bad"}


def words_of_thermal(result: ThermalResult, folder: Path) -> Words:
    """The words of a temperature calibration; `folder`: of its files, for suggested commands."""
    table, choice = result.table, result.choice
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
        degc=",".join(f"{each:g}" for each in degc),
    )


def total_errors(result: ThermalResult) -> list[float]:
    """Errors of all held-out rows before and after, and their noise, mg; none without held-out rows."""
    if not result.held_out:
        return []
    rows = np.array([part.rows for part in result.held_out], float)
    sizes = np.array([(part.before_mg, part.after_mg, part.noise_mg) for part in result.held_out])
    return np.sqrt(rows @ sizes**2 / np.sum(rows)).tolist()


def verdict_of_thermal(result: ThermalResult, words: Words) -> Verdict:
    """The verdict of a temperature calibration in these words."""
    return words.verdict(words.text("badge"), result.table.source, result.calibration.use.words)


@page
def write_thermal_page(path: Path, result: ThermalResult, words: Words) -> None:
    """Write `thermal.html`."""
    tables = value_tables(result)
    for name, columns in {"held out": (0,), "orders": (0, 1, 2, 3)}.items():
        header, *rows = words.blocks[name]
        tables[name] = Table(header, rows, text=columns)
    if result.curves is not None:
        tables["temperature"] = temperature_table(result)
    write_page(
        path,
        words,
        verdict_of_thermal(result, words),
        tone=_TONES.get(result.calibration.use.answer or "yes", "good"),
        tables=tables,
        figures={name: partial(figure, result) for name, figure in {**FIGURES, "changes": small_figure}.items()},
    )


def value_tables(result: ThermalResult) -> dict[str, Table]:
    """The parameters at the reference temperature (`reference`), if they may be used, and the `coefficients` of all curves."""
    tables, model = dict[str, Table](), result.choice.model
    if not result.calibration.use.refused:
        sensor, rows = result.calibration.sensor.of(SENSOR), list[list[str]]()
        for name, value, sd in zip(sensor.names, sensor.values.tolist(), sensor.sd.tolist(), strict=True):
            unit, factor = shown(GROUPS[leaf_of(name)][1])
            assumed = "stated calibration" if model.fixed else "assumed size"
            source = "measured" if leaf_of(name) in model.free else assumed
            rows.append([name, *rounded(value * factor, sd * factor), unit, source])
        tables["reference"] = Table(["parameter", "value", "u", "unit", "source"], rows, text=(0, 3, 4))
    if coefficients := result.coefficients:
        rows = []
        for name, value, sd, unit in coefficients:
            base, divisor = unit.split("/", 1)
            display, factor = shown(base)
            rows.append([name, *_scaled(value * factor, sd * factor), f"{display}/{divisor}"])
        tables["coefficients"] = Table(["coefficient", "value", "u", "unit"], rows, text=(0, 3))
    return tables


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
        k, (unit, factor) = SENSOR.index(name), shown(GROUPS[leaf_of(name)][1])
        cells = [cell for end in (0, 1) for cell in rounded(values[end, k] * factor, sd[end, k] * factor)]
        rows.append([name if known_at_reference(result, name) else f"change of {name}", unit, *cells])
    header = ["parameter", "unit", *(cell for end in degc for cell in (f"at {end:.1f} degC", "u"))]
    return Table(header, rows, text=(0, 1))
