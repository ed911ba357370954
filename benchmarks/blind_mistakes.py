"""Mistakes made in setting up: each takes the columns of a right position file and spoils them.

A column is an array by its name in the file. Random signs and choices come from `rng`; what is physically at fault
(a setting that stood elsewhere, an axis that is dead) is done here to the columns that it would show in.
"""

from collections.abc import Callable

import numpy as np


Columns = dict[str, np.ndarray]
AXES = ("ax_g", "ay_g", "az_g")


def _settings(columns: Columns) -> np.ndarray:
    return np.unique(columns["beta_deg"])


def pitch_from_the_other_end(columns: Columns, rng) -> None:
    """Pitch is counted from the other end of its scale."""
    columns["beta_deg"] = 90.0 - columns["beta_deg"]


def spindle_reversed(columns: Columns, rng) -> None:
    """The spindle turns the other way."""
    columns["alpha_deg"] = (-columns["alpha_deg"]) % 360.0


def spindle_reversed_at_one_setting(columns: Columns, rng) -> None:
    """The spindle was turned the other way at one pitch setting."""
    # At 90 degrees of pitch the spindle stands along gravity, and nothing shows how it turns.
    level = rng.choice(_settings(columns)[:-1])
    own = columns["beta_deg"] == level
    columns["alpha_deg"] = np.where(own, (-columns["alpha_deg"]) % 360.0, columns["alpha_deg"])


def settings_exchanged(columns: Columns, rng) -> None:
    """Two pitch settings have each other's label."""
    low, high = rng.choice(_settings(columns), 2, replace=False)
    beta = columns["beta_deg"]
    columns["beta_deg"] = np.where(beta == low, high, np.where(beta == high, low, beta))


def setting_mislabelled(columns: Columns, rng) -> None:
    """One pitch setting is labelled 15 degrees off."""
    level = rng.choice(_settings(columns)[1:-1])
    columns["beta_deg"] = np.where(columns["beta_deg"] == level, level + 15 * rng.choice([-1, 1]), columns["beta_deg"])


def dead_axis(columns: Columns, rng) -> None:
    """One axis always reads the same."""
    columns[str(rng.choice(AXES))][:] = 0.0123


def doubled_channel(columns: Columns, rng) -> None:
    """Two axes have the same readings."""
    first, second = rng.choice(AXES, 2, replace=False)
    columns[str(first)] = columns[str(second)].copy()


def time_restarts(columns: Columns, rng) -> None:
    """The clock is set to zero at the start and again half way: two runs in one file."""
    time, half = columns["time_s"], len(columns["time_s"]) // 2
    columns["time_s"] = np.concatenate([time[:half] - time[0], time[half:] - time[half]])


def counts_labelled_g(columns: Columns, rng) -> None:
    """Counts of a converter in columns of g."""
    for name in AXES:
        columns[name] = np.round(columns[name] * 16384)
    for name in [name for name in columns if "_sd_" in name]:
        columns[name] = columns[name] * 16384


def kelvin(columns: Columns, rng) -> None:
    """Kelvin in a column of degC."""
    columns["temperature_degc"] = columns["temperature_degc"] + 273.15


def angles_exchanged(columns: Columns, rng) -> None:
    """Spindle and pitch angle have each other's column."""
    columns["alpha_deg"], columns["beta_deg"] = columns["beta_deg"], columns["alpha_deg"]


def spindle_from_another_hole(columns: Columns, rng) -> None:
    """At one pitch setting the spindle was counted from another hole of its index, a step or two of the plan away."""
    level = rng.choice(_settings(columns)[:-1])
    own, step = columns["beta_deg"] == level, np.diff(np.unique(columns["alpha_deg"])).min()
    off = step * rng.choice([-2, -1, 1, 2])
    columns["alpha_deg"] = np.where(own, (columns["alpha_deg"] + off) % 360.0, columns["alpha_deg"])


def spindle_turned_back(columns: Columns, rng) -> None:
    """At every second pitch setting the spindle was turned back again, and the plan's order written down."""
    alpha, levels = columns["alpha_deg"].copy(), _settings(columns)
    for level in levels[rng.integers(2) :: 2]:
        own = np.flatnonzero(columns["beta_deg"] == level)
        alpha[own] = alpha[own[::-1]]
    columns["alpha_deg"] = alpha


def readings_a_row_late(columns: Columns, rng) -> None:
    """The readings of every position stand in the row of the next, those of the last in the first row."""
    for name in _measured(columns):
        columns[name] = np.roll(columns[name], 1)


def a_reading_left_out(columns: Columns, rng) -> None:
    """From some position on the readings stand a row early; the last row is measured again at the end."""
    # At 90 degrees of pitch, where a plan ends, rows look alike.
    first = rng.integers(3, np.sum(columns["beta_deg"] < 90.0) - 1)
    for name in _measured(columns):
        later = columns[name][first:]
        columns[name] = np.concatenate([columns[name][:first], later[1:], later[-1:]])


def sign_lost_at_one_setting(columns: Columns, rng) -> None:
    """One column has the other sign at one pitch setting, where it is not always small."""
    own, name = _at_a_setting(columns, rng), str(rng.choice(AXES[1:]))
    columns[name] = np.where(own, -columns[name], columns[name])


def sign_lost_from_some_row_on(columns: Columns, rng) -> None:
    """One column has the other sign from some position on."""
    name, rows = str(rng.choice(AXES[1:])), np.sum(columns["beta_deg"] < 90.0)
    later = np.arange(len(columns["beta_deg"])) >= rng.integers(rows // 3, rows - rows // 3)
    columns[name] = np.where(later, -columns[name], columns[name])


def columns_exchanged_at_one_setting(columns: Columns, rng) -> None:
    """Two columns stand in each other's place at one pitch setting."""
    own, (first, second) = _at_a_setting(columns, rng), rng.choice(AXES, 2, replace=False)
    one, other = columns[str(first)], columns[str(second)]
    columns[str(first)], columns[str(second)] = np.where(own, other, one), np.where(own, one, other)


def decimal_point_lost(columns: Columns, rng) -> None:
    """One reading is ten, a thousand or a million times too large."""
    row, name = _large_reading(columns, rng)
    columns[name][row] *= 10.0 ** rng.choice([1, 3, 6])


def code_for_a_missing_reading(columns: Columns, rng) -> None:
    """One reading is a number that stands for none."""
    row, name = _large_reading(columns, rng)
    columns[name][row] = rng.choice([-999.0, 9999.0, -32768.0])


def some_rows_in_ms2(columns: Columns, rng) -> None:
    """From some position on, or at a single one, the readings are in m/s^2."""
    first, count = rng.integers(len(columns["beta_deg"]) - 1), rng.choice([1, len(columns["beta_deg"])])
    for name in _measured(columns):
        columns[name][first : first + count] *= 9.80665


def logger_stuck(columns: Columns, rng) -> None:
    """The readings of one position stand in the rows of the next two as well."""
    row = rng.integers(np.sum(columns["beta_deg"] < 90.0) - 3)
    for name in _measured(columns):
        columns[name][row + 1 : row + 3] = columns[name][row]


def clipped(columns: Columns, rng) -> None:
    """One axis ends at its range, which is too small."""
    name, end = str(rng.choice(AXES[1:])), rng.uniform(0.8, 0.93)
    columns[name] = np.clip(columns[name], -end, end)


def _at_a_setting(columns: Columns, rng) -> np.ndarray:
    """Rows of a pitch setting at which all axes show."""
    return columns["beta_deg"] == rng.choice(_settings(columns)[:-1])


def _large_reading(columns: Columns, rng) -> tuple[int, str]:
    """Row and column of a reading that is no small one."""
    rows, axes = np.nonzero(np.abs(np.stack([columns[name] for name in AXES], axis=1)) > 0.3)
    drawn = rng.integers(len(rows))
    return int(rows[drawn]), AXES[axes[drawn]]


def _measured(columns: Columns) -> list[str]:
    """Columns of what is read from the sensor."""
    return [name for name in columns if name in AXES or "_sd_" in name]


# What is spoilt, and the catalogue ids that say so; a refusal in words is right as well.
MISTAKES: dict[str, tuple[Callable[[Columns, np.random.Generator], None], tuple[str, ...]]] = {
    "pitch from the other end": (pitch_from_the_other_end, ("pitch_reversed",)),
    "spindle reversed": (spindle_reversed, ("spindle_reversed", "axis_map")),
    "spindle reversed at one setting": (spindle_reversed_at_one_setting, ("spindle_reversed",)),
    "settings exchanged": (settings_exchanged, ("settings_exchanged",)),
    "setting mislabelled": (setting_mislabelled, ("mislabelled_setting",)),
    "dead axis": (dead_axis, ()),
    "doubled channel": (doubled_channel, ()),
    "time restarts": (time_restarts, ("time_restarts",)),
    "counts labelled g": (counts_labelled_g, ("unit_error",)),
    "temperature in kelvin": (kelvin, ("temperature_unit",)),
    "angle columns exchanged": (angles_exchanged, ("angles_exchanged",)),
    "spindle from another hole": (spindle_from_another_hole, ("index_offset",)),
    "spindle turned back": (spindle_turned_back, ("spindle_reversed",)),
    "readings a row late": (readings_a_row_late, ("rows_shifted",)),
    "a reading left out": (a_reading_left_out, ("rows_shifted",)),
    "sign lost at one setting": (sign_lost_at_one_setting, ("axis_map",)),
    "sign lost from some row on": (sign_lost_from_some_row_on, ("axis_map",)),
    "columns exchanged at one setting": (columns_exchanged_at_one_setting, ("axis_map",)),
    "decimal point lost": (decimal_point_lost, ("decimal_slip",)),
    "code for a missing reading": (code_for_a_missing_reading, ()),
    "some rows in another unit": (some_rows_in_ms2, ("unit_error",)),
    "logger stuck": (logger_stuck, ()),
    "clipped": (clipped, ()),
}
OF_ANGLES = (
    "pitch from the other end",
    "spindle reversed",
    "spindle reversed at one setting",
    "settings exchanged",
    "setting mislabelled",
    "angle columns exchanged",
)
