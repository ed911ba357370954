"""Words beside numbers never say what the numbers contradict."""

from types import SimpleNamespace

import pytest

from tumblecal.ground.numbers_shown import rounded_together
from tumblecal.show.words import words_of


@pytest.mark.parametrize("probability", [0.4, 0.6, 0.67, 0.94, 0.999])
def test_equally_well_is_said_of_equals_alone(probability):
    explanations = [
        SimpleNamespace(probability=p) for p in (probability, *((1.0 - probability) * s for s in (0.7, 0.3)))
    ]
    best = SimpleNamespace(probability=probability, labels=("bias_x",))
    diagnosis = SimpleNamespace(
        verdict="ambiguous", implausible=(), best=best, leading=lambda *_: [best, *explanations[1:]]
    )
    diagnosis.screened, diagnosis.factors = SimpleNamespace(detection=SimpleNamespace(p_value=1e-9)), ()
    words = words_of("diagnosis_headline", d=diagnosis, count=2).text("headline")
    assert ("almost equally well" in words) == (probability <= 2 * explanations[1].probability)


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
