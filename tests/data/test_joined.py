"""Several files as one measurement."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.data import PositionSet
from tumblecal.data.joined import joined, runs_apart
from tumblecal.ground.errors import InputError


def part(start, **columns):
    alpha = start + np.arange(3.0)
    return PositionSet(
        tuple(f"p{a:g}" for a in alpha), alpha, alpha / 2, np.ones((3, 3)) * start, source=f"{start}.csv", **columns
    )


def test_rows_follow_each_other():
    first = part(0, time_s=np.array([5.0, 7.0, 9.0]), n=np.ones(3), comments={"operator": "A"})
    second = part(10, time_s=np.array([100.0, 101.0, 102.0]), mount=("B",) * 3)
    both = joined([first, second])
    assert both.names == first.names + second.names and both.source == "0.csv, 10.csv"
    np.testing.assert_array_equal(both.readings[:, 0], [0, 0, 0, 10, 10, 10])
    np.testing.assert_array_equal(both.beta_deg, [0, 0.5, 1, 5, 5.5, 6])
    # The second session begins one mean step after the first; labels left out are 1; n is not in both.
    np.testing.assert_array_equal(both.time_s, [5, 7, 9, 11, 12, 13])
    assert both.mount == ("1", "1", "1", "B", "B", "B") and both.run is None and both.n is None
    assert both.comments == {"operator": "A"}


def test_names_that_repeat_from_file_to_file_are_told_apart():
    first, second = replace(part(0), source="m0.csv"), replace(part(2), source="m1.csv")
    assert joined([first, second]).names == ("p0", "p1", "m0:p2", "m1:p2", "p3", "p4")
    same = [replace(first, source=f"{folder}/m.csv") for folder in ("in/one", "in/two", "in/two")]
    assert joined(same).names[::3] == ("one:p0", "two:p0", "two 2:p0")


def test_one_set_stays_as_it_is():
    alone = part(0)
    assert joined([alone]) is alone


def test_some_with_standard_deviations():
    with_sd = part(0, sd=np.full((3, 3), 1e-4))
    with pytest.raises(InputError, match=r"10\.csv: no sd columns, but other files have them"):
        joined([with_sd, part(10)])
    assert joined([with_sd, replace(with_sd, source="b")]).sd.shape == (6, 3)


def test_one_g_is_the_same_in_all():
    here, there = ({"gravity_ms2": value} for value in ("9.8123", "9.7803"))
    with pytest.raises(InputError, match=r"one g is not the same .* 0\.csv 9\.8123, 10\.csv 9\.7803; .*--gravity"):
        joined([part(0, comments=here), part(10, comments=there)])
    assert len(joined([part(0, comments=here), part(10, comments={})])) == 6


def test_each_file_is_a_run_of_its_own_unless_it_says_so():
    def runs(*sets):
        return joined(runs_apart(sets)).run

    first, second = part(0), part(10)
    assert runs(first, second) == ("0",) * 3 + ("10",) * 3
    assert runs(replace(first, run=("10", "a", "a")), second) == ("10", "a", "a") + ("10 2",) * 3
    # Files of one name are told by their folders; of one folder too, by numbers.
    same = [replace(first, source=f"{folder}/positions.csv") for folder in ("in/one", "in/two", "in/two")]
    assert runs(*same) == ("one",) * 3 + ("two",) * 3 + ("two 2",) * 3
    # A mounting of its own says as much.
    assert runs(first, replace(second, mount=("B",) * 3)) is None
    assert runs(first, replace(second, mount=("1",) * 3)) == ("0",) * 3 + ("10",) * 3
    assert runs_apart([first]) == [first]
