"""The diagnosis of a triad that was remounted turned: the turn is no fault, and faults are found beside it."""

import numpy as np
import pytest

from remounted import blind, two


pytestmark = pytest.mark.long


NONE = (0.0, 0.0, 0.0)


def test_a_turn_is_no_fault_and_an_effect_is_found_beside_it(diagnoser):
    """About y, where two of the mount's angles would otherwise turn about the same axis."""
    turn = (0.0, 90.0, 0.0)
    data, *_ = two(2, NONE, turn)
    diagnosis = diagnoser(data, noise_sd=blind.SIGMA)
    assert (
        diagnosis.verdict == "adequate" and diagnosis.mountings == {"A": NONE, "B": turn} and not diagnosis.setup_errors
    )
    data, first, second = two(3, NONE, turn, square_y=1e-3)
    diagnosis = diagnoser(data, noise_sd=blind.SIGMA)
    assert diagnosis.labels == ("second_order.y",)
    for label, truth in (("A", first), ("B", second)):
        columns = [diagnosis.model.names.index(f"dtheta_{axis}@mount={label}") for axis in "xyz"]
        np.testing.assert_allclose(diagnosis.extended.vector[columns], truth["dtheta"], atol=3e-4)
