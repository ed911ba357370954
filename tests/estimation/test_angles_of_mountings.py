"""Slips of the angles with a triad that was remounted: of all mountings, and of one of them; blind cases in plain numpy."""

import zlib
from dataclasses import replace

import numpy as np
import pytest

from blind.conditions import CONDITIONS, drawn, write
from remounted import two
from tumblecal.data import read_positions
from tumblecal.estimation.setup_correction import correct_setup_errors
from tumblecal.ground.errors import InputError


def spoilt(condition, tmp_path):
    """A position set of a condition, with the ids of which each is a right answer."""
    rng = np.random.default_rng([44, zlib.crc32(condition.encode())])
    case = drawn(condition, rng)
    write(tmp_path / "data.csv", case.data)
    return read_positions(tmp_path / "data.csv"), {ids[0] for ids in case.accepted}


REVERSED_IN_B = "remounted, mistake in B: spindle reversed"


def test_a_spindle_reversed_in_one_mounting_is_an_axis_of_the_other_sign_there(tmp_path):
    """Which of both nothing tells: neither is put right, and both are said."""
    words = r"in mount B the axes are mirrored .* or.*spindle .* opposite sign in mounting B"
    with pytest.raises(InputError, match=words):
        correct_setup_errors(spoilt(REVERSED_IN_B, tmp_path)[0])


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


ORIENTATIONS = ((0.0, 90.0, 0.0), (180.0, 0.0, 0.0), (0.0, 0.0, 0.0))
WIRED_WRONGLY = {
    "column z is -z": lambda readings: readings * [1.0, 1.0, -1.0],
    "column x is -x": lambda readings: readings * [-1.0, 1.0, 1.0],
    "column x is y; column y is x": lambda readings: readings[:, [1, 0, 2]],
}


@pytest.mark.parametrize(("words", "orientation"), [*zip(WIRED_WRONGLY, ORIENTATIONS, strict=True)])
def test_columns_of_the_whole_file_are_told_before_slips_of_each_mounting(words, orientation):
    """Slips of the angles, one in each mounting, had been told for one axis of the other sign."""
    data, *_ = two(1, (0.0, 0.0, 0.0), orientation)
    mended, setup_errors = correct_setup_errors(replace(data, readings=WIRED_WRONGLY[words](data.readings)))
    assert [setup_error.label for setup_error in setup_errors] == ["axis_map"]
    assert words in setup_errors[0].words
    np.testing.assert_array_equal(mended.readings, data.readings)
