"""Position sets that are made in Python: what does not fit together is said by name, not by numpy.

The tests' own shape checker, which users do not have, is passed by.
"""

import numpy as np
import pytest

from tumblecal import InputError
from tumblecal.data import PositionSet


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
