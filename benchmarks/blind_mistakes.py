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
}
OF_ANGLES = (
    "pitch from the other end",
    "spindle reversed",
    "spindle reversed at one setting",
    "settings exchanged",
    "setting mislabelled",
    "angle columns exchanged",
)
