"""Lines, table, document and figure of recordings that are built by hand."""

from dataclasses import replace

import numpy as np
from recordings_made import recording_of

from tumblecal.data.positions import PositionSet
from tumblecal.recordings.columns import Column, Layout
from tumblecal.recordings.damage import Damage, DamageRecord
from tumblecal.recordings.dwells.dwell_samples import DwellSamples
from tumblecal.recordings.options import Criterion
from tumblecal.recordings.record import import_record
from tumblecal.recordings.rows import Unread
from tumblecal.recordings.still.blocks import SignalBlocks
from tumblecal.recordings.still.intervals import Interval
from tumblecal.recordings.still.stillness import Stillness
from tumblecal.recordings.table import Table
from tumblecal.show.recordings import grouped_lines, import_lines, reduction_lines


COLUMNS = {"time": Column("t", "s", "name")} | {
    f"a{axis}": Column(f"Acc{axis}", "counts", "name", "option") for axis in "xyz"
}
LAYOUT = Layout(COLUMNS, 2048.0, 2050.4, ("unit guessed: 2048/g",))
FAULTY = {
    "rows": 900,
    "rate_hz": 100.0,
    "unread": Unread(4, [3, 8, 9]),
    "mixed_rates": (80.0, 100.0),
    "missing": 1,
    "equal_times": 2,
    "gaps": ((1.0, 2.5), (4.0, -3.0), (6.0, 0.5)),
    "temperature": (21.0, 24.5, 7),
    "damage": Damage(
        [DamageRecord("repeats", "each sample twice", rows=900), DamageRecord("format", "a byte is lost")]
    ),
}


def test_each_finding_is_in_a_text(snapshot):
    """Lines of earlier cases are not repeated."""
    untimed = Layout({role: column for role, column in COLUMNS.items() if role != "time"}, None, 1.0, ())
    rates = Table("gyro", (), lambda columns: iter(()), 5, words="rates")
    faulty, other = recording_of(LAYOUT, more_tables=[rates], **FAULTY), recording_of(LAYOUT, path="g.csv", **FAULTY)
    sound = recording_of(replace(LAYOUT, notes=()), rows=100, rate_hz=100.0)
    cases = {
        "import": import_lines(faulty),
        "import of samples without times": import_lines(recording_of(untimed, rows=1)),
        "one file": lines_of(faulty),
        "two files": lines_of(sound, other),
        "intervals": lines_of(stillness=stillness_of(14, joins=1), lines=["missing: 3"]),
        "coarse intervals of one attitude": lines_of(stillness=stillness_of(0, east=(0.0, 0.1, 1.0), noise=1e-3)),
        "equal findings": grouped_lines([("a", "one"), ("b", "two"), ("c", "one")]),
    }
    texts, seen = dict[str, str](), set[str]()
    for title, lines in cases.items():
        new = [line for line in lines if line not in seen]
        texts[title] = "\n".join(new)
        seen |= {*new}
    snapshot("recordings", texts)


def test_the_document_of_an_import_has_null_for_what_is_unknown(tmp_path):
    content = import_record(tmp_path / "a", tmp_path / "b", recording_of(LAYOUT, rows=9)).plain()
    assert {key for key, value in content.items() if value is None} == {
        "rate_hz",
        "duration_s",
        "temperature_degc",
        "repeats",
    }
    content = import_record(tmp_path / "a", tmp_path / "b", recording_of(LAYOUT, **FAULTY)).plain()
    assert content["gaps"] == {"count": 2, "total_s": 3.0, "first_s": 1.0} and content["duration_s"] == 9.0
    assert content["clock_back"] == {"count": 1, "first_s": 4.0} and content["temperature_degc"] == [21.0, 24.5]
    assert content["repeats"]["rows"] == 900 and [one["kind"] for one in content["damage"]] == ["repeats", "format"]


def stillness_of(rejected: int, joins: int = 0, noise: float = 1.0, east: tuple = (0.0, 1.0, 0.0)) -> Stillness:
    """Two intervals that are used, and others that are not; readings in steps of 5 mg."""
    count = 40
    ends, number = np.zeros((count, 6)), np.arange(count)
    blocks = SignalBlocks(
        10, 100.0, 400, np.tile([0, 0, 1.0], (count, 1)), np.zeros((count, 3)), ends, ends.astype(int), 10 * number,
        number / 10, np.array([200, 400]), np.array([], int), np.full(3, 5e-3), "g",
    )  # fmt: skip
    one = [Interval(0, 9, 0.0, 0.9, np.array([0, 0, 1.0])), Interval(10, 20, 1.0, 2.0, np.array(east))]
    one += [
        Interval(20 + k, 21 + k, 2 + k, 2.5 + k, np.array([1.0, 0, 0]), (), "short: 0.5 s") for k in range(rejected)
    ]
    return Stillness(Criterion(), one, np.full(3, noise), np.ones(3), blocks, joins)


def lines_of(*recordings, stillness=None, lines=()):
    data = PositionSet(("p",), np.zeros(1), np.zeros(1), np.array([[0, 0, 1.0]]))
    return reduction_lines(
        DwellSamples(data, [np.zeros((2, 3))], 100.0, read=recordings, stillness=stillness, lines=lines)
    )
