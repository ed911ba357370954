"""Words beside numbers never say what the numbers contradict."""

import pytest

from tumblecal.diagnosis.tuning import SURE
from tumblecal.ground.numbers_shown import rounded, rounded_together
from tumblecal.report.number_words import ambiguity


@pytest.mark.parametrize("probability", [0.4, 0.6, SURE, 0.94, 0.999])
@pytest.mark.parametrize("alike", [True, False])
def test_equally_well_is_said_of_equals_alone(probability, alike):
    others = [(1.0 - probability) * share for share in (0.7, 0.3)]
    said = ambiguity(probability, others, alike=alike)
    assert ("equally well" in said) == (probability <= 2 * others[0])
    assert ("cannot tell apart" in said) == (alike and probability >= SURE)


@pytest.mark.parametrize(
    ("value", "u", "words"),
    [
        (0.20149, 0.01346, "0.201 +- 0.013"),
        (-0.00004, 0.0996, "0.00 +- 0.10"),
        (1234.6, 123.4, "1230 +- 120"),
        (0.5321, 6.2, "0.5 +- 6.2"),
        (17.04, 57.0, "17 +- 57"),
        (1.5, 0.0, "1.5000 +- 0.0000"),
    ],
)
def test_uncertainties_have_two_digits_and_values_the_same_decimal(value, u, words):
    """GUM 7.2.6."""
    assert rounded_together(value, u) == words


def test_further_uncertainties_have_the_same_decimal():
    assert rounded(1.23456, 0.0123, 0.1999) == ["1.235", "0.012", "0.200"]
