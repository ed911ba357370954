"""Set-up errors: each changes the columns of a correct position file. Random choices come from `rng`."""

from collections.abc import Callable

import numpy as np


Columns = dict[str, np.ndarray]
Mistake = Callable[[Columns, np.random.Generator], None]
AXES = ("ax_g", "ay_g", "az_g")
# By name: the error, and the ids of the catalogue that name it. An error message is a correct answer as well.
MISTAKES: dict[str, tuple[Mistake, tuple[str, ...]]] = {}
OF_ANGLES = (
    "pitch from the other end",
    "spindle reversed",
    "spindle reversed at one setting",
    "settings exchanged",
    "setting mislabelled",
    "angle columns exchanged",
)


def named_by(*ids: str) -> Callable[[Mistake], Mistake]:
    """List a mistake, by the words of its function's name."""

    def listed(mistake: Mistake) -> Mistake:
        MISTAKES[mistake.__name__.replace("_", " ")] = mistake, ids
        return mistake

    return listed


def _settings(columns: Columns) -> np.ndarray:
    return np.unique(columns["beta_deg"])


def _at_a_setting(columns: Columns, rng: np.random.Generator) -> np.ndarray:
    """Rows of a pitch setting at which all axes are visible: at 90 degrees the spindle is along gravity."""
    return columns["beta_deg"] == rng.choice(_settings(columns)[:-1])


def _large_reading(columns: Columns, rng: np.random.Generator) -> tuple[int, str]:
    rows, axes = np.nonzero(np.abs(np.stack([columns[name] for name in AXES], axis=1)) > 0.3)
    drawn = rng.integers(len(rows))
    return int(rows[drawn]), AXES[axes[drawn]]


def _measured(columns: Columns) -> list[str]:
    return [name for name in columns if name in AXES or "_sd_" in name]


def _rows_below_90(columns: Columns) -> int:
    return int(np.sum(columns["beta_deg"] < 90.0))


@named_by("pitch_reversed")
def pitch_from_the_other_end(columns, rng):
    columns["beta_deg"] = 90.0 - columns["beta_deg"]


@named_by("spindle_reversed", "axis_map")
def spindle_reversed(columns, rng):
    columns["alpha_deg"] = (-columns["alpha_deg"]) % 360.0


@named_by("spindle_reversed")
def spindle_reversed_at_one_setting(columns, rng):
    own, alpha = _at_a_setting(columns, rng), columns["alpha_deg"]
    columns["alpha_deg"] = np.where(own, (-alpha) % 360.0, alpha)


@named_by("settings_exchanged")
def settings_exchanged(columns, rng):
    low, high = rng.choice(_settings(columns), 2, replace=False)
    beta = columns["beta_deg"]
    columns["beta_deg"] = np.where(beta == low, high, np.where(beta == high, low, beta))


@named_by("mislabelled_setting")
def setting_mislabelled(columns, rng):
    """The label is in error by 15 degrees."""
    level, beta = rng.choice(_settings(columns)[1:-1]), columns["beta_deg"]
    columns["beta_deg"] = np.where(beta == level, level + 15 * rng.choice([-1, 1]), beta)


@named_by()
def dead_axis(columns, rng):
    columns[str(rng.choice(AXES))][:] = 0.0123


@named_by()
def doubled_channel(columns, rng):
    first, second = rng.choice(AXES, 2, replace=False)
    columns[str(first)] = columns[str(second)].copy()


@named_by("time_restarts")
def time_restarts(columns, rng):
    time, half = columns["time_s"], len(columns["time_s"]) // 2
    columns["time_s"] = np.concatenate([time[:half] - time[0], time[half:] - time[half]])


@named_by("unit_error")
def counts_labelled_g(columns, rng):
    for name in _measured(columns):
        columns[name] = np.round(columns[name] * 16384) if name in AXES else columns[name] * 16384


@named_by("temperature_unit")
def temperature_in_kelvin(columns, rng):
    columns["temperature_degc"] = columns["temperature_degc"] + 273.15


@named_by("angles_exchanged")
def angle_columns_exchanged(columns, rng):
    columns["alpha_deg"], columns["beta_deg"] = columns["beta_deg"], columns["alpha_deg"]


@named_by("index_offset")
def spindle_from_another_hole(columns, rng):
    """At one pitch setting, a step or two of the plan away."""
    own, alpha = _at_a_setting(columns, rng), columns["alpha_deg"]
    shift = np.diff(np.unique(alpha)).min() * rng.choice([-2, -1, 1, 2])
    columns["alpha_deg"] = np.where(own, (alpha + shift) % 360.0, alpha)


@named_by("spindle_reversed")
def spindle_turned_back(columns, rng):
    """At every second setting the angles were measured backwards, and listed in the order of the plan."""
    alpha, levels = columns["alpha_deg"].copy(), _settings(columns)
    for level in levels[rng.integers(2) :: 2]:
        own = np.flatnonzero(columns["beta_deg"] == level)
        alpha[own] = alpha[own[::-1]]
    columns["alpha_deg"] = alpha


@named_by("rows_shifted")
def readings_a_row_late(columns, rng):
    for name in _measured(columns):
        columns[name] = np.roll(columns[name], 1)


@named_by("rows_shifted")
def a_reading_left_out(columns, rng):
    """From some position on the readings are a row early; the last row is measured again at the end."""
    first = rng.integers(3, _rows_below_90(columns) - 1)
    for name in _measured(columns):
        later = columns[name][first:]
        columns[name] = np.concatenate([columns[name][:first], later[1:], later[-1:]])


@named_by("axis_map")
def sign_lost_at_one_setting(columns, rng):
    own, name = _at_a_setting(columns, rng), str(rng.choice(AXES[1:]))
    columns[name] = np.where(own, -columns[name], columns[name])


@named_by("axis_map")
def sign_lost_from_some_row_on(columns, rng):
    name, rows = str(rng.choice(AXES[1:])), _rows_below_90(columns)
    later = np.arange(len(columns["beta_deg"])) >= rng.integers(rows // 3, rows - rows // 3)
    columns[name] = np.where(later, -columns[name], columns[name])


@named_by("axis_map")
def columns_exchanged_at_one_setting(columns, rng):
    own, (first, second) = _at_a_setting(columns, rng), rng.choice(AXES, 2, replace=False)
    one, other = columns[str(first)], columns[str(second)]
    columns[str(first)], columns[str(second)] = np.where(own, other, one), np.where(own, one, other)


@named_by("decimal_slip")
def decimal_point_lost(columns, rng):
    """One reading is ten, a thousand or a million times too large."""
    row, name = _large_reading(columns, rng)
    columns[name][row] *= 10.0 ** rng.choice([1, 3, 6])


@named_by()
def code_for_a_missing_reading(columns, rng):
    row, name = _large_reading(columns, rng)
    columns[name][row] = rng.choice([-999.0, 9999.0, -32768.0])


@named_by("unit_error")
def some_rows_in_another_unit(columns, rng):
    """From some position on, or at a single one, the readings are in m/s^2."""
    first, count = rng.integers(len(columns["beta_deg"]) - 1), rng.choice([1, len(columns["beta_deg"])])
    for name in _measured(columns):
        columns[name][first : first + count] *= 9.80665


@named_by()
def logger_stuck(columns, rng):
    """The readings of one position are repeated in the next two rows."""
    row = rng.integers(_rows_below_90(columns) - 3)
    for name in _measured(columns):
        columns[name][row + 1 : row + 3] = columns[name][row]


@named_by()
def clipped(columns, rng):
    """One axis saturates at a range that is too small."""
    name, end = str(rng.choice(AXES[1:])), rng.uniform(0.8, 0.93)
    columns[name] = np.clip(columns[name], -end, end)
