"""Several files as one measurement."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.data import PositionSet
from tumblecal.data.joined import joined, with_separate_runs
from tumblecal.data.joined_clocks import joined_clocks
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
    # The clock goes on from the first file to the second; labels left out are 1; n is not in both.
    np.testing.assert_array_equal(both.time_s, [5, 7, 9, 100, 101, 102])
    assert both.mount == ("1", "1", "1", "B", "B", "B") and both.run is None and both.n is None
    assert both.comments == {"operator": "A"}


def test_each_file_is_a_run_of_its_own_unless_it_says_so():
    def runs(*sets):
        return joined(with_separate_runs(sets)).run

    first, second = part(0), part(10)
    assert runs(first, second) == ("0",) * 3 + ("10",) * 3
    assert runs(replace(first, run=("10", "a", "a")), second) == ("10", "a", "a") + ("10 2",) * 3
    # Files of one name are told by their folders; of one folder too, by numbers.
    same = [replace(first, source=f"{folder}/positions.csv") for folder in ("in/one", "in/two", "in/two")]
    assert runs(*same) == ("one",) * 3 + ("two",) * 3 + ("two 2",) * 3
    # A mounting of its own says as much.
    assert runs(first, replace(second, mount=("B",) * 3)) is None
    assert runs(first, replace(second, mount=("1",) * 3)) == ("0",) * 3 + ("10",) * 3
    assert with_separate_runs([first]) == [first]


TEN = np.array([0.0, 5.0, 10.0])
MARCH = {"time_zero": "2026-03-14T10:00:00Z"}
# Times and comments of the second file, what is stated; the second file's first time, None where the pause is unknown.
PAUSES = {
    "goes on": (7200 + TEN, {}, (), 7200.0),
    "starts again": (TEN, {}, (), None),
    "moments in the files": (TEN, {"time_zero": "2026-03-14T13:00:00+01:00"}, (), 7200.0),
    "twice as fast": (TEN, {"time_zero": "2026-03-14T12:00:00Z", "time_speed": "2"}, (), 14400.0),
    "recordings of one clock": (TEN, {"time_began_s": "7300"}, (), 7200.0),
    "stated": (TEN, {}, ("2 h",), 7210.0),
    "stated as unknown": (7200 + TEN, {}, ("unknown",), None),
}


@pytest.mark.parametrize("case", PAUSES)
def test_the_pause_between_two_files(case):
    """The pause was always taken as one mean step."""
    time, comments, stated, begins = PAUSES[case]
    first = part(0, time_s=TEN, comments=MARCH if "time_zero" in comments else {"time_began_s": "100"})
    second = part(10, time_s=time, comments=comments)
    clocks = joined_clocks([first, second], stated)
    both = joined([first, second], clocks)
    assert len(clocks.words) == 1 and ("unknown (" in clocks.words[0]) == (begins is None)
    if begins is None:
        assert both.clock == ("1",) * 3 + ("2",) * 3 and np.all(np.diff(both.time_s) > 0)
    else:
        assert both.clock is None
        np.testing.assert_allclose(both.time_s, [*TEN, *(begins + TEN)], atol=1e-6)


def test_files_by_two_clocks_and_what_is_not_a_pause():
    """The third file goes on from the second, whose clock starts again."""
    sets = [part(0, time_s=TEN), part(10, time_s=TEN), part(20, time_s=100 + TEN)]
    both = joined(sets)
    assert both.clock == ("1",) * 3 + ("2",) * 6
    np.testing.assert_allclose(both.time_s[6] - both.time_s[3], 100.0)
    with pytest.raises(InputError, match="given 3 times for 2 pauses"):
        joined_clocks(sets, ["1 h", "2 h", "3 h"])
    with pytest.raises(InputError, match=r"unknown or none.*'2' has no unit; write"):
        joined_clocks(sets, ["2"])
    with pytest.raises(InputError, match=r"10\.csv has no column time_s"):
        joined_clocks([sets[0], part(10)], ["2 h"])
    damaged = replace(sets[1], comments={"time_zero": "yesterday"})
    with pytest.raises(InputError, match=r"10\.csv: comment time_zero: 'yesterday' is not a date and time"):
        joined_clocks([sets[0], damaged])
    assert joined([sets[0], part(10)]).time_s is None
