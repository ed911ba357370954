"""Position sets that are made in Python: what does not fit together is said by name, not by numpy.

The tests' own shape checker, which users do not have, is passed by.
"""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal import InputError
from tumblecal.data import PositionSet
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_extended import corrected
from tumblecal.data.triad_of_rows import ConstantTriad


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"readings": np.zeros((24, 2))}, r"readings has the shape \(24, 2\); it must be \(24, 3\), for 24 names"),
        ({"sd": np.full((24, 3), -1e-4)}, "sd must be above 0"),
        ({"readings": np.full((24, 3), np.nan)}, "readings has numbers that are not finite"),
        ({"temperature_degc": np.full(24, np.inf)}, "temperature_degc has numbers that are not finite"),
        ({"run": ("1",) * 5}, "run has 5 labels; it must have 24"),
    ],
)
def test_columns_that_do_not_fit_are_named(table1, change, words):
    wrong = object.__new__(PositionSet)
    vars(wrong).update(vars(table1) | change)
    with pytest.raises(InputError, match=words):
        wrong.__post_init__()


def test_readings_and_temperatures_of_another_shape_are_named():
    term = {"axis": "x", "coefficient": 1e-5, "powers": [0, 0, 0], "per_degc": True, "reference_degc": 25.0}
    # Not through the shape checker of the tests, which would reject the shapes first.
    unchecked = getattr(corrected, "__wrapped__", corrected)
    linear = Calibration(np.eye(3), np.zeros(3), np.zeros((12, 12)))
    for calibration in (linear, replace(linear, extra={"terms": [term]})):
        given = ConstantTriad(calibration.matrix, calibration.bias), calibration.terms
        np.testing.assert_allclose(unchecked(*given, np.ones((4, 3)), np.full(4, 25.0)), 1)
        with pytest.raises(InputError, match=r"readings have the shape \(4, 2\)"):
            unchecked(*given, np.ones((4, 2)), 25.0)
        with pytest.raises(
            InputError, match=r"temperature_degc has the shape \(3,\); it must be one number, or \(4,\)"
        ):
            unchecked(*given, np.ones((4, 3)), np.ones(3))
