"""Slips of the angles with a triad that was remounted: of all mountings, and of one of them; blind cases in plain numpy."""

import zlib

import numpy as np
import pytest

from blind.conditions import CONDITIONS, drawn, write
from tumblecal.data import read_positions
from tumblecal.estimation.setup.correction import correct_setup_errors


def spoilt(condition, tmp_path):
    """A position set of a condition, with the ids of which each is a right answer."""
    rng = np.random.default_rng([44, zlib.crc32(condition.encode())])
    case = drawn(condition, rng)
    write(tmp_path / "data.csv", case.data)
    return read_positions(tmp_path / "data.csv"), {ids[0] for ids in case.accepted}


REVERSED_IN_B = "remounted, mistake in B: spindle reversed"


@pytest.mark.parametrize(
    "condition", [name for name in CONDITIONS if name.startswith("remounted, mistake") and name != REVERSED_IN_B]
)
def test_a_slip_is_put_right_whichever_mountings_have_it(condition, tmp_path):
    """The second mounting put right had undone the first; a slip hid how the triad stood."""
    data, ids = spoilt(condition, tmp_path)
    mended, (slip, *more) = correct_setup_errors(data)
    assert not more and ids & {slip.label, *(label for label, _ in slip.equal)}
    assert correct_setup_errors(mended)[1] == []
    rows = np.array(data.mount) == "B"
    moved = (mended.alpha_deg != data.alpha_deg) | (mended.beta_deg != data.beta_deg)
    moved |= np.any(mended.readings != data.readings, axis=1)
    if " in B" in condition:
        assert np.any(moved[rows]) and not np.any(moved[~rows]) and "in mounting B" in slip.words
    else:
        assert all(np.any(moved[np.array(data.mount) == own]) for own in "ABC")


def test_two_mountings_may_have_slips_of_their_own(tmp_path):
    data, _ = spoilt("remounted, mistake in B: setting mislabelled", tmp_path)
    first = np.array(data.mount) == "A"
    spoilt_too = data.beta_deg.copy()
    spoilt_too[first] = 90.0 - spoilt_too[first]
    both = type(data)(**{**vars(data), "beta_deg": spoilt_too})
    mended, slips = correct_setup_errors(both)
    assert [slip.label for slip in slips] == ["pitch_reversed", "mislabelled_setting"]
    assert [slip.words.rpartition(" ")[2] for slip in slips] == ["A", "B"]
    alone, _ = correct_setup_errors(data)
    np.testing.assert_allclose(mended.beta_deg, alone.beta_deg, atol=1.0)
