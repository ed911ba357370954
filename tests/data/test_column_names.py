"""The meaning of column names as loggers, phones and spreadsheets write them."""

import pytest

from tumblecal.data.column_names import parsed


# Name: quantity, axis, unit and state, by what the name says in words.
NAMES = {
    "Accelerometer X [g]": ("acceleration", "x", "g", ""),
    "acc_y_mg": ("acceleration", "y", "mg", ""),
    "AccelZ (m/s^2)": ("acceleration", "z", "ms2", ""),
    "acceleration without gravity x (m/s²)": ("acceleration", "x", "ms2", "free"),
    "acceleration with gravity x (m/s²)": ("acceleration", "x", "ms2", ""),
    "gravity free acceleration y": ("acceleration", "y", "", "free"),
    "linear acceleration z": ("acceleration", "z", "", "linear"),
    "gravity x": ("gravity", "x", "", ""),
    "gyro_x_dps": ("rate", "x", "dps", ""),
    "angular velocity y (rad/s)": ("rate", "y", "rads", ""),
    "magnetometer z": ("field", "z", "", ""),
    "Temperature [°C]": ("temperature", "", "degc", ""),
    "timestamp_ms": ("time", "", "ms", ""),
    "seconds_elapsed": ("time", "", "s", ""),
    "rotation rate x": ("rate", "x", "", ""),
}


@pytest.mark.parametrize("name", NAMES)
def test_a_name_says_quantity_axis_unit_and_state(name):
    found = parsed(name)
    assert (found.quantity, found.axis, found.unit, found.state) == NAMES[name]
