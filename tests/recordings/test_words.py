"""Words, table, document and figure of recordings that are built by hand."""

import re

import numpy as np
import pytest
from recordings_made import recording_of

from tumblecal.data.positions import PositionSet
from tumblecal.recordings.columns import Column, Layout
from tumblecal.recordings.damage import Damage, DamageRecord
from tumblecal.recordings.dwells.dwell_samples import DwellSamples
from tumblecal.recordings.options import Criterion
from tumblecal.recordings.rows import Unread
from tumblecal.recordings.still.blocks import SignalBlocks
from tumblecal.recordings.still.intervals import Interval
from tumblecal.recordings.still.stillness import Stillness
from tumblecal.recordings.table import Table
from tumblecal.report.recording_words import import_document, import_lines, recording_words, reduction_words
from tumblecal.show.figures.interval import interval_figure


COLUMNS = {"time": Column("t", "s", "name")} | {
    f"a{axis}": Column(f"Acc{axis}", "counts", "name; unit: option") for axis in "xyz"
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
LEFT_OUT = "4 rows left out, without a whole reading: 3, 8, 9, ..."
CLOCK = [
    "the rate changes between 80 and 100 Hz; the sd of means use the average",
    "1 sample missing according to the clock",
    "2 samples with the time of the previous one",
    "the clock jumps back 1 time, first at 4.00 s; no interval goes across",
    "2 gaps, 3.0 s in all, first at 1.00 s; no interval goes across",
]


def test_the_table_of_an_import():
    others = Table("gyro", (), lambda columns: iter(()), 5, words="rates")
    lines = import_lines(recording_of(LAYOUT, more_tables=[others], **FAULTY))
    assert [re.split(r"\s\s+", line.strip()) for line in lines] == [
        ["text"],
        ["*"],
        ["gyro (rates), 5 rows"],
        ["item", "found", "unit", "evidence"],
        ["rows", "900 samples", LEFT_OUT],
        ["rate", "100 Hz, 9.0 s", "from the times, without gaps"],
        ["time", "t", "s", "name"],
        *([f"a{a}", f"Acc{a}", "counts (2048 a g)", "name; unit: option"] for a in "xyz"),
        ["size", "about 2050.4", "counts", "of gravity in ax, ay, az"],
        *(["gaps", line] for line in CLOCK),
        ["repeats", "each sample twice"],
        ["damage", "a byte is lost"],
        ["temperature", "temperature 21.00 to 24.50 degC, none in 7 rows"],
        ["unit guessed: 2048/g"],
    ]
    # Columns are aligned.
    assert {lines[k].index(word) for k, word in ((3, "evidence"), (6, "name"), (8, "name"), (10, "of gravity"))} == {47}
    untimed = Layout({role: column for role, column in COLUMNS.items() if role != "time"}, None, 1.0, ())
    lines = [line.split() for line in import_lines(recording_of(untimed, rows=1))]
    assert lines[3][:4] == ["rate", "not", "known", "(--rate)"]
    assert lines[-3:] == [["gaps", "none"], ["repeats", "none"], ["damage", "none"]]


def test_the_document_of_an_import_has_null_for_what_is_unknown(tmp_path):
    content = import_document(tmp_path / "a", tmp_path / "b", recording_of(LAYOUT, rows=9))
    assert {key for key, value in content.items() if value is None} == {
        "rate_hz",
        "duration_s",
        "temperature_degc",
        "repeats",
    }
    content = import_document(tmp_path / "a", tmp_path / "b", recording_of(LAYOUT, **FAULTY))
    assert content["gaps"] == {"count": 2, "total_s": 3.0, "first_s": 1.0} and content["duration_s"] == 9.0
    assert content["clock_back"] == {"count": 1, "first_s": 4.0} and content["temperature_degc"] == [21.0, 24.5]
    assert content["repeats"]["rows"] == 900 and [one["kind"] for one in content["damage"]] == ["repeats", "format"]


def stillness_of(rejected: int, joins: int = 0, noise: float = 1e-3) -> Stillness:
    """Two intervals that are used, and others that are not; readings in steps of 5 mg."""
    count = 40
    ends, number = np.zeros((count, 6)), np.arange(count)
    blocks = SignalBlocks(
        10, 100.0, 400, np.tile([0, 0, 1.0], (count, 1)), np.zeros((count, 3)), ends, ends.astype(int), 10 * number,
        number / 10, np.array([200, 400]), np.array([], int), np.full(3, 5e-3), "g",
    )  # fmt: skip
    one = [Interval(0, 9, 0.0, 0.9, np.array([0, 0, 1.0])), Interval(10, 20, 1.0, 2.0, np.array([0, 1.0, 0]))]
    one += [
        Interval(20 + k, 21 + k, 2 + k, 2.5 + k, np.array([1.0, 0, 0]), (), "short: 0.5 s") for k in range(rejected)
    ]
    return Stillness(Criterion(), one, np.full(3, noise), np.ones(3), blocks, joins)


def words_of(*recordings, stillness=None, lines=()):
    data = PositionSet(("p",), np.zeros(1), np.zeros(1), np.array([[0, 0, 1.0]]))
    return [
        *reduction_words(
            DwellSamples(data, [np.zeros((2, 3))], 100.0, read=recordings, stillness=stillness, lines=lines)
        )
    ]


@pytest.mark.parametrize(("joins", "noise"), [(0, 1.0), (1, 1e-3), (3, 1e-3)])
def test_intervals_in_words(joins, noise):
    first, *lines = words_of(stillness=stillness_of(14, joins, noise), lines=["missing: 3"])
    assert first.startswith("2 still intervals (probability of rejecting a still second 1e-06 per axis; at least 1.5 s")
    joined = {1: "1 interval follows the one before without", 3: "3 intervals follow the ones before without"}
    assert lines.pop(0).startswith(joined[joins]) if joins else True
    steps = "axes x, y, z: readings in steps of 5 mg, wider than the noise"
    assert lines.pop(0).startswith(steps) if noise < 1 else True
    assert lines[0].startswith("sizes of the intervals are not tested")
    assert lines[1:13] == [f"rejected: {2 + k}.0 to {2 + k}.5 s: short: 0.5 s" for k in range(12)]
    assert lines[13:] == ["and 2 more (reduction.json)", "missing: 3"]


def test_several_files_in_words():
    """The layout of the first, then what differs in others, and their faults."""
    lines = words_of(recording_of(LAYOUT, rows=100, rate_hz=100.0), recording_of(LAYOUT, path="g.csv", **FAULTY))
    assert lines[1] == "columns: time=t, ax=Accx, ay=Accy, az=Accz"
    assert lines[-8:-2] == [f"g.csv: {line}" for line in (LEFT_OUT, *CLOCK)]
    assert lines[-2:] == ["1000 samples of 2 files at 100 Hz", "positions from the columns of the files"]
    alone = [*recording_words(recording_of(LAYOUT, **FAULTY))]
    assert alone[-7:] == [*CLOCK, LEFT_OUT, "temperature 21.00 to 24.50 degC, none in 7 rows"]


@pytest.mark.parametrize("rejected", [0, 3])
def test_the_figure_of_intervals(rejected):
    figure = interval_figure(stillness_of(rejected), ("up", "east"))
    (axes,) = figure.axes
    assert axes.get_title() == f"2 still intervals used (green), {rejected} refused (red)"
    (names,) = axes.child_axes
    assert [label.get_text() for label in names.get_xticklabels()] == ["up", "east"]
    assert len(axes.patches) == 2 + rejected
    # A gap is no line.
    assert [bool(np.isnan(line.get_ydata()).any() or np.isnan(line.get_xdata()).any()) for line in axes.lines] == [
        True
    ] * 3
