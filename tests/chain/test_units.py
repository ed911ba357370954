"""Units by name."""

import math
import re

import pytest

from tumblecal import InputError
from tumblecal.ground.units import factor, quantity


@pytest.mark.parametrize(
    ("unit", "target", "expected"),
    [
        ("mg", "g", 1e-3),
        ("mrad", "rad", 1e-3),
        ("arcmin", "rad", math.pi / 10800),
        ("deg", "arcsec", 3600.0),
        ("m/s^2", "g", 1 / 9.80665),
        ("mg/g^2", "1/g", 1e-3),
        ("(mg/g)/h", "1/s", 1e-3 / 3600),
        ("%", "1", 0.01),
        ("ppm", "1e-3", 1e-3),
    ],
)
def test_factors(unit, target, expected):
    assert factor(unit, target) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "target", "words"),
    [
        ("0.1", "g", "'0.1' has no unit; write for example '0.1 mg'"),
        ("3", "rad", "'3' has no unit; write for example '3 mrad'"),
        ("2", "g/s", "'2' has no unit; write for example '2 mg/h'"),
        ("two", "1", "is not a number with a unit, such as '1 ppm'"),
        ("mg", "g", "'mg' is not a number with a unit, such as '1 mg'"),
        ("0.1 furlong", "g", "unknown unit 'furlong'"),
        ("3 arcmin", "g", "their dimensions differ"),
        ("1e999 mg", "g", "is not finite"),
    ],
)
def test_bad_quantities_say_why(text, target, words):
    with pytest.raises(InputError, match=words) as refused:
        quantity(text, target)
    if example := re.search("'([^']*)'$", str(refused.value)):
        assert math.isfinite(quantity(example[1], target))
