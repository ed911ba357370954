"""Several files as one recording: positions from names and tables, means of the still parts, clocks, faults."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from recordings_made import ANGLES

from tumblecal.capture.capture_plan import read_plan
from tumblecal.data import read_positions
from tumblecal.ground.errors import InputError
from tumblecal.recordings import reduce
from tumblecal.recordings.dwells.file_names import recording_files
from tumblecal.recordings.dwells.places import places_by_names, places_by_table
from tumblecal.recordings.options import KnownContext, RecordingOptions


FACES = {"x_p": (1, 0, 0), "x_n": (-1, 0, 0), "y_p": (0, 1, 0), "y_n": (0, -1, 0), "z_p": (0, 0, 1), "z_n": (0, 0, -1)}
BIAS = np.array([0.2, -0.1, 0.05])
SCALE = np.array([[1.01, 0.01, -0.02], [0.0, 0.99, 0.015], [0.0, 0.0, 1.005]])


def write(
    path: Path, up, *, start_s=0.0, rate=100.0, rows=500, names="time_s,ax_g,ay_g,az_g", order=(0, 1, 2), unit=1.0
):
    """A file at rest between two movements; returns what it reads there, g."""
    rng = np.random.default_rng(len(path.name) + rows)
    force = SCALE @ np.asarray(up, float) + BIAS
    samples = force + 1e-3 * rng.normal(size=(rows, 3))
    samples[: round(rate)] += 0.4 * rng.normal(size=(round(rate), 3))
    table = np.column_stack([start_s + np.arange(rows) / rate, unit * samples[:, order]])
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, table, delimiter=",", fmt="%.5f", header=names, comments="")
    return force


def faces(folder: Path, **more) -> list[Path]:
    for name, up in FACES.items():
        write(folder / f"{name}.csv", up, **more)
    return recording_files([folder])


def reduced(files, plan=None, **context):
    return reduce.reduced(files, KnownContext(plan=plan, **context))


def doubts_of(found):
    """The warnings on files whose samples can be read."""
    return [(source, *lines) for source, lines in found.dwells.warnings if lines]


def angles_of(names, plan):
    """The angles that the names give, or None where that is a question."""
    try:
        places = places_by_names([Path("d") / name for name in names], read_plan(plan), hand_held=False).places
    except InputError:
        return None
    return [(place.alpha_deg, place.beta_deg) for place in places]


def test_files_have_the_names_of_positions(six, grid):
    names = ["x_p.csv", "X_N.txt", "y_p.csv", "y_n.csv", "sub/z_p.csv", "z_n.csv"]
    expected = [ANGLES[name] for name in FACES]
    assert angles_of(names, six) == expected and angles_of(names[::-1], six) == expected[::-1]
    assert angles_of(["1.csv", "2.csv", "24.csv"], grid) == [(0, 0), (45, 0), (315, 90)]


def test_a_folder_and_patterns_hold_recordings_in_natural_order(tmp_path):
    for name in ("pos_10.csv", "pos_2.csv", "notes.md", "plan.toml", ".hidden.csv", "positions.csv", "b/pos_1.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("x")
    order = [tmp_path / "b/pos_1.csv", tmp_path / "pos_2.csv", tmp_path / "pos_10.csv"]
    assert recording_files([tmp_path]) == order
    assert recording_files([tmp_path / "pos_*.csv"]) == order[1:]
    given = [tmp_path / "z.csv", tmp_path / "a.csv"]
    assert recording_files(given) == given
    with pytest.raises(InputError, match="no file of a recording"):
        recording_files([tmp_path / "nothing*.csv"])


def test_means_are_those_of_the_still_part_of_each_file(tmp_path, six):
    files = faces(tmp_path / "faces")
    write(tmp_path / "faces" / "again" / "x_p.csv", (1, 0, 0))
    files = recording_files([tmp_path / "faces"])
    found = reduced(files, six)
    data = found.data
    assert sorted(data.names) == ["x_n", "x_p", "x_p (2)", "y_n", "y_p", "z_n", "z_p"]
    for name, alpha, beta, reading, n in zip(
        data.names, data.alpha_deg, data.beta_deg, data.readings, data.n, strict=True
    ):
        face = next(key for key, angles in ANGLES.items() if angles == (alpha, beta))
        np.testing.assert_allclose(reading, SCALE @ FACES[face] + BIAS, atol=5e-3 / np.sqrt(n), err_msg=name)
        assert 300 < n < 400
    # Nothing says when one file was recorded after another: no time that a drift could be fitted to.
    assert data.time_s is None
    assert data.clock is None
    assert not doubts_of(found)


def test_hand_held_files_with_several_intervals_have_clocks_of_their_own(tmp_path):
    rng = np.random.default_rng(1)
    for name, first, second in (("a", "x_p", "y_p"), ("b", "z_p", "z_n")):
        parts = [SCALE @ FACES[own] + BIAS + 1e-3 * rng.normal(size=(400, 3)) for own in (first, second)]
        moving = rng.normal(size=(100, 3))
        table = np.vstack([parts[0], moving, parts[1]])
        rows = "\n".join(",".join(f"{v:.5f}" for v in (k / 100, *row)) for k, row in enumerate(table))
        (tmp_path / f"{name}.csv").write_text(f"time_s,ax_g,ay_g,az_g\n{rows}\n")
    data = reduced([tmp_path / "a.csv", tmp_path / "b.csv"], static=True).data
    assert data.hand_held
    assert data.names == ("a", "a (2)", "b", "b (2)")
    assert data.clock == ("1", "1", "2", "2")
    np.testing.assert_allclose(data.readings[3], SCALE @ FACES["z_n"] + BIAS, atol=3e-4)


def test_a_table_gives_positions_run_and_mount(tmp_path, six):
    files = faces(tmp_path / "f")
    table = tmp_path / "files.csv"
    rows = [
        f"f/{name}.csv,{name[0]}{name[2]},{a},{b},{1 if name[0] == 'x' else 2},M" for name, (a, b) in ANGLES.items()
    ]
    table.write_text("file,position,alpha_deg,beta_deg,run,mount\n" + "\n".join(rows) + "\n")
    data = reduced(files, table=table).data
    runs = zip(data.names, data.run, strict=True)
    assert all(run == ("1" if name[0] == "x" else "2") for name, run in runs)
    assert set(data.mount) == {"M"}
    np.testing.assert_array_equal(data.alpha_deg[[data.names.index("yn"), data.names.index("zn")]], [-90, 180])
    table.write_text("file,name\n" + "\n".join(f"{name},{name}" for name in ANGLES) + "\n")
    by_plan = reduced(files, six, table=table).data
    assert dict(zip(by_plan.names, by_plan.beta_deg, strict=True))["x_n"] == 90


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("file,position\nx_p.csv,x_p\n", "column file: no line for d/x_n.csv; write one row"),
        ("file\nx_p.csv\n", "column alpha_deg and beta_deg is missing; write a row for each file"),
        ("alpha_deg\n1\n", "column file and beta_deg is missing"),
        ("file,position\nx_p.csv,a\nx_n,noon\n", "line 2, column position: 'a' is not a position of the plan: x_p"),
        ("file,alpha_deg,beta_deg\nx_p.csv,1,up\nx_n,0,0\n", "line 2, column beta_deg: 'up' is not a number"),
        ("file,alpha_deg,beta_deg\nx_p.csv,1,0\nx_n,0,0\nx_p,3,4\n", "line 2, 4 for d/x_p.csv"),
    ],
)
def test_faults_of_a_table(content, words, tmp_path, six):
    (tmp_path / "files.csv").write_text(content)
    with pytest.raises(InputError, match=words):
        places_by_table([Path("d/x_p.csv"), Path("d/x_n.csv")], tmp_path / "files.csv", read_plan(six))


def spoil(folder: Path, how: str) -> None:
    path = folder / "z_p.csv"
    if how == "empty":
        path.write_text("")
    elif how == "unit":
        write(path, (0, 0, 1), names="time_s,ax_ms2,ay_ms2,az_ms2", unit=9.80665)
    elif how == "rate":
        write(path, (0, 0, 1), rate=40.0)
    elif how == "times":
        write(path, (0, 0, 1), names="n,ax_g,ay_g,az_g")
    elif how == "columns":
        names = "time_s,acc_raw_x_g,acc_raw_y_g,acc_raw_z_g,acc_x_g,acc_y_g,acc_z_g"
        for name in FACES:
            zeros = np.array([0, 0, 0, 1, 1, 1]) if name == "z_p" else 1.0
            write(folder / f"{name}.csv", FACES[name], names=names, order=(0, 1, 2, 0, 1, 2), unit=zeros)
    elif how == "serial":
        for name, serial in (("z_p", "B2"), ("x_p", "B1")):
            own = folder / f"{name}.csv"
            own.write_text(f"# serial_number: {serial}\n{own.read_text()}")


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("empty", "z_p.csv: the file is empty"),
        ("unit", "z_p.csv: accelerations in m/s^2, but in"),
        ("rate", "samples a second, but"),
        ("columns", "z_p.csv: accelerations in the columns acc_x_g, acc_y_g, acc_z_g, but in"),
        ("times", "z_p.csv: no column of times, but"),
        ("serial", "z_p.csv: serial_number B2, but in"),
    ],
)
def test_files_that_are_not_of_one_recording(how, words, tmp_path, six):
    files = faces(tmp_path / "f")
    spoil(tmp_path / "f", how)
    with pytest.raises(InputError) as fault:
        reduced(files, six)
    assert words in str(fault.value)


def test_positions_by_a_column_of_several_files(tmp_path):
    for name, place in (("a", "p,0,0"), ("b", "q,90,0")):
        rows = [f"{k / 100},{0.001 * (k % 3)},{name == 'b':d},{name == 'a':d},{place}" for k in range(40)]
        (tmp_path / f"{name}.csv").write_text("\n".join(["time_s,ax_g,ay_g,az_g,part,alpha_deg,beta_deg", *rows, ""]))
    found = reduced([tmp_path / "a.csv", tmp_path / "b.csv"], by="part")
    assert found.data.names == ("p", "q") and found.data.alpha_deg.tolist() == [0, 90]
    assert any("the pauses between the files are unknown" in line for line in found.dwells.lines)


def test_files_without_times_have_the_stated_rate(tmp_path, six):
    """And a second attitude in one of them is not its position."""
    files = faces(tmp_path / "f", names="n,ax_g,ay_g,az_g")
    with pytest.raises(InputError, match=r"x_n.csv: the sample rate is not known; give --rate 100"):
        reduced(files, six)
    lines = [(tmp_path / "f" / f"{name}.csv").read_text().splitlines() for name in ("x_p", "z_p")]
    (tmp_path / "f" / "x_p.csv").write_text("\n".join([*lines[0], *lines[1][1:300], ""]))
    found = reduce.reduced(files, KnownContext(plan=six), RecordingOptions(rate=100.0))
    assert sorted(found.data.names) == sorted(FACES) and found.data.time_s is None
    (refused,) = (one.reason for one in found.dwells.stillness.intervals if one.reason)
    assert re.fullmatch(r"attitude: 9\d deg from the longest interval at rest of x_p.csv", refused)


def test_dates_order_the_files_and_are_the_time(tmp_path, six):
    for number, (name, up) in enumerate(FACES.items()):
        write(tmp_path / "f" / f"{name}.csv", up, start_s=1.7e9 - 60.0 * number)
    data = reduced(recording_files([tmp_path / "f"]), six).data
    assert data.names == ("z_n", "z_p", "y_n", "y_p", "x_n", "x_p")
    np.testing.assert_allclose(np.diff(data.time_s), 60.0, atol=0.2)
    assert data.comments["time_zero"] == "2023-11-14T22:08:20.000Z"


def test_the_command_prints_the_positions_before_a_fault(tmp_path, tumblecal, six):
    faces(tmp_path / "f")
    out = tmp_path / "out"
    done = tumblecal("reduce", tmp_path / "f", "--plan", six, "--no-figures", "--out", out)
    assert done.code == 0
    content = json.loads((out / "reduction.json").read_text())
    assert [own["position"] for own in content["files"]] == ["x_n", "x_p", "y_n", "y_p", "z_n", "z_p"]
    assert len(read_positions(out / "positions.csv")) == 6
    (tmp_path / "f" / "z_p.csv").write_text("")
    failed = tumblecal("reduce", tmp_path / "f", "--plan", six, "--out", out)
    assert failed.code == 2
    assert any("z_p.csv  z_p  alpha 0  beta 0" in line for line in failed.lines)
