"""Still intervals of simulated sessions: found, none invented, and every odd end told in a line."""

from itertools import pairwise

import numpy as np
import polars as pl
import pytest
from recordings_made import ATTITUDES, imu_columns, made

from hand_held_sessions import Hand, counts, drawn
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.reduce import reduced
from tumblecal.recordings.still.blocks import blocks_of
from tumblecal.recordings.still.stillness import still_intervals
from tumblecal.show.recordings import reduction_lines


HAND_HELD = KnownContext(static=True)


def written(tmp_path, s, **changed):
    """The session as a Parquet table, with some columns changed."""
    path = tmp_path / "s.parquet"
    pl.DataFrame(imu_columns(s) | changed).write_parquet(path)
    return path


def words(reduction):
    return "\n".join(reduction_lines(reduction.dwells))


@pytest.mark.parametrize(
    ("sessions", "with_rates"),
    [(4, True), *(pytest.param(12, rates, marks=pytest.mark.long) for rates in (False, True))],
)
def test_intervals_of_simulated_sessions_are_found_and_none_invented(sessions, with_rates):
    rows = [counts(drawn(900 + seed), with_rates=with_rates) for seed in range(sessions)]
    true, found, taken, false = np.sum(rows, axis=0)
    assert found >= 0.99 * true
    assert false <= 0.01 * taken


def found_in(tmp_path, force, rate_hz):
    """What lies still in accelerations (g)."""
    columns = {f"a{axis}_g": force[:, k] for k, axis in enumerate("xyz")}
    pl.DataFrame(columns).write_parquet(tmp_path / "f.parquet")
    return still_intervals(blocks_of(tmp_path / "f.parquet", list(columns), rate_hz, timed=False))


def imperfect(attitudes, offset):
    """What a cheap triad reads in these directions: scales in error by up to 8 %, an offset, axes not orthogonal."""
    matrix = np.array([[1.08, 0.01, -0.02], [0.015, 0.93, 0.01], [0.01, -0.02, 1.02]])
    return attitudes / np.linalg.norm(attitudes, axis=1, keepdims=True) @ matrix.T + offset * np.array([1, -1, 1])


FACES = np.array([[0, 0, 1], [0, 0, -1], [0, 1, 0], [0, -1, 0], [1, 0, 0], [-1, 0, 0]], float)
NEAR = np.array([[np.sin(a), 0, np.cos(a)] for a in np.radians([0, 3, 6, 9])])


@pytest.mark.parametrize(
    ("rate_hz", "length_s", "noise", "step", "attitudes"),
    [
        (20, 1.5, 5e-3, 0, FACES),
        (50, 1.5, 0.0, 1 / 8, FACES),
        (500, 3, 3e-4, 0, NEAR),
        (2000, 1.5, 1e-3, 1 / 256, FACES),
    ],
)
@pytest.mark.parametrize("offset", [0.0, 0.6])
def test_faces_that_follow_one_another_without_movement_are_parted(
    tmp_path, rate_hz, length_s, noise, step, attitudes, offset
):
    """The logger runs only at rest, or one file per face was joined: intervals end where the faces do, to the row."""
    rng = np.random.default_rng(1)
    rows = np.ceil(rate_hz * length_s * np.linspace(1, 1.2, len(attitudes))).astype(int)
    force = np.repeat(imperfect(attitudes, offset), rows, axis=0) + noise * rng.normal(size=(rows.sum(), 3))
    force = step * np.round(force / step) if step else force
    stillness = found_in(tmp_path, force, rate_hz)
    ends = [0, *np.cumsum(rows).tolist()]
    assert [(one.start, one.stop, one.reason) for one in stillness.intervals] == [
        (*pair, "") for pair in pairwise(ends)
    ]
    assert stillness.joins == len(attitudes) - 1


def test_a_small_jump_within_an_interval_parts_it_and_slow_changes_do_not(tmp_path):
    """Drift of 10 mg, warm-up of 10 mg and flicker noise of 1 mg leave one interval; a jump by 6 mg is one."""
    rng, rows = np.random.default_rng(2), 6000
    time = np.arange(rows)[:, None] / 100
    noise = 1e-3 * rng.normal(size=(rows, 3))
    spectrum = rng.normal(size=(rows // 2 + 1, 3)) / np.sqrt(np.maximum(np.arange(rows // 2 + 1), 1))[:, None]
    flicker = np.fft.irfft(spectrum, rows, axis=0)
    slow = {"drift": 0.01 * time / 60, "warm-up": 0.01 * np.exp(-time / 5), "flicker": 1e-3 * flicker / flicker.std()}
    for name, change in slow.items():
        assert len(found_in(tmp_path, noise + change + np.array([0.4, 0.3, 1.2]), 100.0).used) == 1, name
    for length_s in (0.0, 0.3):
        share = np.clip((time - 25) / (length_s or 1e-9), 0, 1)
        jump = found_in(tmp_path, noise + 6e-3 * share + np.array([0.4, 0.3, 1.2]), 100.0)
        assert [len(jump.used), jump.joins] == [2, 1], length_s
        assert abs(jump.used[0].stop - 2500) < 60 and abs(jump.used[1].start - 2500) < 60


@pytest.mark.parametrize("offset", [0.0, 0.35, 0.6])
def test_sizes_are_judged_about_the_bias_of_each_axis(tmp_path, offset):
    """All attitudes count, whatever the offset; one that is accelerated by half a g does not."""
    rng = np.random.default_rng(4)
    s = made(Hand(), attitudes=rng.normal(size=(20, 3)))
    force = imperfect(np.eye(3), 0.0).T
    s.force[slice(*s.still[7])] *= 1.5
    stillness = found_in(tmp_path, s.force @ force + offset * np.array([1, -1, 1]), 100.0)
    assert stillness.size_judged and len(stillness.used) == 19
    (refused,) = (one for one in stillness.intervals if one.reason)
    assert refused.reason == "size: 1.50 times that of the others" or refused.reason.startswith("size: 1.4")


def test_verdicts_do_not_depend_on_the_unit(tmp_path):
    s = made(Hand(tremor_g=2e-3))
    one = reduced([written(tmp_path, s)], HAND_HELD)
    counts_of = {f"acc_{axis}": 16384 * s.force[:, k] for k, axis in enumerate("xyz")}
    other = reduced([written(tmp_path, s, **counts_of)], HAND_HELD, RecordingOptions(unit="16384/g"))
    assert one.dwells.stillness and other.dwells.stillness
    assert [(i.start, i.stop) for i in one.dwells.stillness.used] == [
        (i.start, i.stop) for i in other.dwells.stillness.used
    ]
    np.testing.assert_allclose(one.data.readings, other.data.readings, rtol=1e-9)


def test_a_knock_is_left_out_and_parts_no_interval(tmp_path):
    s = made()
    start, stop = s.still[2]
    middle = (start + stop) // 2
    force = s.force.copy()
    force[middle : middle + 5] += [0.3, -0.2, 0.1]
    force[s.still[4][0] + 100, 1] += 5.0
    columns = {f"acc_{axis}": 9.80665 * force[:, k] for k, axis in enumerate("xyz")}
    plain = reduced([written(tmp_path, s)], HAND_HELD)
    knocked = reduced([written(tmp_path, s, **columns)], HAND_HELD)
    assert knocked.dwells.stillness and len(knocked.dwells.stillness.used) == len(ATTITUDES)
    assert knocked.dwells.stillness.used[2].knocks
    np.testing.assert_allclose(knocked.data.readings, plain.data.readings, atol=3e-4)


def test_gaps_and_clocks_that_jump_back_part_intervals_and_are_told(tmp_path):
    s = made()
    gap, back = s.still[1].mean().astype(int), s.still[5].mean().astype(int)
    rows = np.arange(len(s.time_s))
    time = s.time_s + np.where(rows >= gap, 30.0, 0.0) - np.where(rows >= back, 40.0, 0.0)
    reduction = reduced([written(tmp_path, s, time=time)], HAND_HELD, criterion=Criterion(least_s=1.0))
    assert reduction.dwells.stillness
    assert not any(one.start < row < one.stop for one in reduction.dwells.stillness.used for row in (gap, back))
    assert len(reduction.dwells.stillness.used) == len(ATTITUDES) + 2
    said = words(reduction)
    assert "1 gap, 30.0 s in all" in said
    assert "the clock jumps back 1 time" in said
    assert reduction.dwells.read[0].rate_hz == pytest.approx(100.0)
