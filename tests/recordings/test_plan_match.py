"""Still intervals recognised as the positions of a plan, in its order or in any; what is missing or surplus is told."""

import numpy as np
import polars as pl
import pytest
from recordings_made import imu_columns, made, text

from hand_held_sessions import Hand
from tumblecal.capture.capture_plan import CapturePlan, read_plan
from tumblecal.data import read_positions
from tumblecal.ground.errors import InputError
from tumblecal.recordings.dwells.plan_match import matched
from tumblecal.recordings.options import KnownContext, RecordingOptions
from tumblecal.recordings.reduce import reduced


def readings(plan: CapturePlan, order, *, bias=(0.0, 0.0, 0.0), seed=1):
    """What a triad with a bias and a few degrees of misalignment reads at these positions of a plan."""
    rng = np.random.default_rng(seed)
    expected = np.array([plan.expected(k) for k in order])
    return expected @ (np.eye(3) + 0.03 * rng.normal(size=(3, 3))) + bias


def names(plan):
    return [str(step.name) for step in plan.steps]


def test_missing_repeated_and_surplus_intervals_are_told(grid):
    plan = read_plan(grid)
    order = [0, 1, 2, 2, 4, 5, 6, 7, *range(8, 24)]
    given = readings(plan, order)
    given = np.insert(given, 10, [0.45, -0.45, 0.77], axis=0)
    match = matched(given, plan)
    assert match.positions.tolist() == [*order[:10], -1, *order[10:]]
    assert match.words() == ["missing: 4", "measured again: 3"]
    assert match.surplus == [10]


@pytest.mark.parametrize("seed", range(3))
def test_offsets_of_cheap_sensors_hide_no_position(six, grid, seed):
    """They turn directions by up to 30 degrees: their own middle, or a sphere, gives them. One face may be missing."""
    bias = 0.6 * np.array([1, -1, 1]) * [[1, 1, 1], [0, 0, 1], [1, 0.5, 0]][seed]
    plan, rng = read_plan(six), np.random.default_rng(seed)
    order = rng.permutation(6)
    for taken in (order, order[1:]):
        match = matched(readings(plan, taken, bias=bias, seed=seed) * [1.08, 0.95, 1.0], plan)
        assert match.positions.tolist() == taken.tolist()
    plan = read_plan(grid)
    match = matched(readings(plan, range(24), bias=bias, seed=seed), plan)
    assert match.positions.tolist() == list(range(24))


def session_of(plan, order, seed=2):
    """A recorded session at these positions of a plan."""
    return made(Hand(), seed, np.array([plan.expected(k) for k in order]))


def test_a_recording_of_a_plan_has_its_angles_names_mount_and_gravity(tmp_path, grid, tumblecal):
    plan = read_plan(grid)
    # Positions that look the same to gravity are parted by a movement of their own.
    s = session_of(plan, [*range(16), 16])
    path = text(tmp_path / "run.csv", s, ",", imu_columns(s))
    result = tumblecal("reduce", path, "--plan", grid, "--run", "2", "--out", tmp_path / "out")
    assert result.code == 0, result.lines
    assert "missing: 18, 19, 20, 21, 22, 23, 24" in result.out
    data = read_positions(tmp_path / "out" / "positions.csv")
    assert data.names == tuple(str(k + 1) for k in range(17))
    np.testing.assert_array_equal(data.alpha_deg, [*(45.0 * np.arange(8)), *(45.0 * np.arange(8)), 0])
    assert data.mount == ("B",) * 17
    assert data.run == ("2",) * 17
    assert data.gravity is not None and data.gravity.source == "given"
    assert not data.hand_held


@pytest.mark.parametrize("suffix", [".csv", ".xlsx"])
def test_a_table_of_means_becomes_a_hand_held_set(tmp_path, tumblecal, suffix):
    s = made()
    means = np.array([s.force[a:b].mean(0) for a, b in s.still])
    frame = pl.DataFrame(
        {"side": [f"s{k}" for k in range(len(means))]} | {f"m{k}": 9.80665 * means[:, k] for k in range(3)}
    )
    path = tmp_path / f"means{suffix}"
    frame.write_csv(path) if suffix == ".csv" else frame.write_excel(path)
    columns = "ax=m0,ay=m1,az=m2,position=side"
    result = tumblecal(
        "reduce", path, "--means", "--columns", columns, "--gravity", "9.80665", "--out", tmp_path / "out"
    )
    assert result.code == 0, result.lines
    data = read_positions(tmp_path / "out" / "positions.csv")
    assert data.hand_held
    assert data.names[:2] == ("s0", "s1")
    np.testing.assert_allclose(data.readings, means, rtol=1e-12)


@pytest.mark.parametrize("named", [True, False])
def test_means_are_positions_of_a_plan_by_name_or_direction(tmp_path, six, named):
    plan, order = read_plan(six), [4, 0, 5, 3, 1, 2]
    force = readings(plan, order, bias=(0.1, -0.2, 0.05))
    columns = {f"a{axis}_g": force[:, k] for k, axis in enumerate("xyz")}
    frame = pl.DataFrame(columns | {"position": [names(plan)[k] for k in order]})
    (frame if named else frame.drop("position")).write_csv(tmp_path / "means.csv")
    data = reduced([tmp_path / "means.csv"], KnownContext(plan=six, means=True)).data
    np.testing.assert_array_equal(data.beta_deg, [plan.steps[k].beta_deg for k in order])
    assert not named or data.names == tuple(frame["position"])
    frame[0, "position"], frame[0, "ax_g"], frame[0, "ay_g"] = "z_up", 0.9, 0.9
    (frame if named else frame.drop("position")).write_csv(tmp_path / "means.csv")
    with pytest.raises(InputError, match=r"means.csv: row 1: not a position of the plan \(1 such rows\); remove them"):
        reduced([tmp_path / "means.csv"], KnownContext(plan=six, means=True))


def test_positions_named_by_a_column_get_the_plans_angles(tmp_path, six):
    plan = read_plan(six)
    s = session_of(plan, range(6))
    label = np.full(len(s.time_s), "turning", dtype=object)
    for (start, stop), name in zip(s.still, names(plan), strict=True):
        label[start + 20 : stop - 20] = name
    columns = imu_columns(s) | {"part": label, "session": np.full(len(label), "monday")}
    pl.DataFrame(columns).write_csv(tmp_path / "parts.txt")
    data = reduced(
        [tmp_path / "parts.txt"], KnownContext(plan=six, by="part"), RecordingOptions(columns="run=session")
    ).data
    assert data.names == tuple(names(plan))
    np.testing.assert_array_equal(data.beta_deg, [-90, 90, 0, 0, 0, 0])
    assert data.run == ("monday",) * 6
    with pytest.raises(InputError, match="none of its position names is in"):
        reduced([tmp_path / "parts.txt"], KnownContext(plan=six, by="session"))
