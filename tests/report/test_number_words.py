"""Words beside numbers never say what the numbers contradict."""

import pytest

from tumblecal.diagnosis.tuning import SURE
from tumblecal.report.number_words import ambiguity


@pytest.mark.parametrize("probability", [0.4, 0.6, SURE, 0.94, 0.999])
@pytest.mark.parametrize("alike", [True, False])
def test_equally_well_is_said_of_equals_alone(probability, alike):
    others = [(1.0 - probability) * share for share in (0.7, 0.3)]
    said = ambiguity(probability, others, alike=alike)
    assert ("equally well" in said) == (probability <= 2 * others[0])
    assert ("cannot tell apart" in said) == (alike and probability >= SURE)
