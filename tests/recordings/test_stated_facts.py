"""What a file states about its clock and columns; numbers that cannot be times or readings."""

import numpy as np
import pytest

from tumblecal.ground.errors import InputError
from tumblecal.recordings.clock import unit_of_times
from tumblecal.recordings.library import read_recording


@pytest.mark.parametrize("begin_s", [10.0, 1100.0, 2017.0, 4100.0, 1.7e9])
@pytest.mark.parametrize(("unit", "scale"), [("us", 1e-6), ("ns", 1e-9)])
@pytest.mark.parametrize("rate_hz", [50.0, 250.0])
def test_a_time_since_the_start_of_a_device_is_no_date(begin_s, unit, scale, rate_hz):
    """Microseconds after 17 minutes look like seconds since 1970, but the rate does not; without a rate they are a question."""
    times = np.round((begin_s + np.arange(500) / rate_hz) / scale)
    assert unit_of_times(times, "t", rate_hz, "log.csv")[0] == unit
    if begin_s > 1e9:
        assert unit_of_times(times, "t", None, "log.csv")[0] == unit
        return
    with pytest.raises(InputError, match=rf"no unit of the times is stated.*--time-unit {unit} \({rate_hz:g} Hz\)"):
        unit_of_times(times, "t", None, "log.csv")


def text(path, header, rows, form="%.6g"):
    np.savetxt(path, rows, form, ",", header=header, comments="")
    return path


@pytest.fixture
def force():
    return np.repeat(np.eye(3), 100, axis=0) + 1e-3 * np.random.default_rng(1).normal(size=(300, 3))


def test_times_that_contradict_a_stated_rate_are_not_used(tmp_path, force):
    """A counter of 16 bits at 500 Hz; a duration, which does not rise, is no clock at any rate."""
    duration = 0.01 + 1e-4 * np.random.default_rng(2).normal(size=300)
    log = text(tmp_path / "log.csv", "Time,ax_g,ay_g,az_g", np.column_stack([duration, force]))
    assert read_recording(log).rate_hz is None
    counter = np.arange(300) * 98 % 65536
    log = text(tmp_path / "log.csv", "TIME_STMP,ax_g,ay_g,az_g", np.column_stack([counter, force]))
    recording = read_recording(log, rate=500.0)
    assert recording.rate_hz == 500.0 and "time" not in recording.layout.columns
    assert any("no unit of its times gives 500 Hz: not used" in note for note in recording.layout.notes)


def test_rows_that_are_no_readings_are_left_out(tmp_path, force):
    """The first lines of a file without names: start, and number of samples."""
    rows = np.vstack([np.full((2, 3), [[1.7e9], [310000.0]]), 64 * force])
    recording = read_recording(text(tmp_path / "log.csv", "ax,ay,az", rows), unit="64/g", rate=32.0)
    assert recording.rows == 300
    assert [(record.kind, record.rows, record.first_row) for record in recording.damage.records] == [
        ("impossible", 2, 1)
    ]


def test_columns_of_one_name_are_proposed_by_what_they_are(tmp_path, force):
    """A column of times before each channel; the pasted line gives the right columns and units."""
    times = np.arange(300) / 100
    rows = np.column_stack([column for axis in range(3) for column in (times, force[:, axis])])
    log = text(tmp_path / "log.csv", "X [s],Acc X [g],X [s],Acc Y [g],X [s],Acc Z [g]", rows)
    with pytest.raises(InputError, match="this name occurs twice") as fault:
        read_recording(log)
    option = str(fault.value).rpartition("--columns ")[2]
    assert option == "time_s=1,ax_g=2,ay_g=4,az_g=6"
    recording = read_recording(log, columns=option)
    np.testing.assert_allclose(recording.frame().select("ax_g", "ay_g", "az_g").collect().to_numpy(), force, atol=1e-5)
    assert recording.rate_hz == pytest.approx(100.0)


@pytest.mark.parametrize(("attitudes", "size", "unit"), [(12, 900, "mg"), (12, 800, "counts"), (1, 800, "mg")])
def test_several_attitudes_show_the_size_of_gravity_more_closely(tmp_path, attitudes, size, unit):
    """In one attitude a bias of 0.2 g may be the cause; over several it is not, and 800 counts a g are not mg."""
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(attitudes, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    rows = size * np.repeat(directions, 100, axis=0) + rng.normal(size=(100 * attitudes, 3))
    log = text(tmp_path / "log.csv", "accX,accY,accZ", rows)
    assert read_recording(log, rate=100.0).layout.unit == unit


@pytest.mark.parametrize(
    ("header", "row", "first"),
    [
        ("time,accX,accY,accZ,gone", "{t:.2f},{x:.4f},{y:.4f},{z:.4f},,,", ""),  # columns that are empty in all rows
        ("time,accX,accY,accZ,Temp [C],Temp [C]", "{t:.2f},{x:.4f},{y:.4f},{z:.4f},20,21", ""),  # a name twice
        ("time,accX,accY,accZ,OBD", "{t:.2f},{x:.4f},{y:.4f},{z:.4f},7.5", "{t:.2f},{x:.4f},{y:.4f},{z:.4f},-"),
        ("time,accelerometer_x,accelerometer_y,accelerometer_z,linear_acceleration_x,linear_acceleration_y,"
         "linear_acceleration_z", "{t:.2f},{x:.4f},{y:.4f},{z:.4f},{x:.4f},{y:.4f},{z:.4f}", ""),
        ("time,accX,accY,accZ", "2025-8-11 23:1:{t:.2f},{x:.4f},{y:.4f},{z:.4f}", ""),  # no leading zeros
        ("time,accX,accY,accZ", "  {t:.2f},  {x:.4f}, {y:.4f},  {z:.4f}", ""),
        ("GPST,Ax,Ay,Az", "{t:.2f},{x:.4f},{y:.4f},{z:.4f}", ""),
        ("Zeit [h],Ax,Ay,Az", "{h:.9f},{x:.4f},{y:.4f},{z:.4f}", ""),
        # A letter g next to names of accelerations is no rate; the time that a step lasts is no clock.
        ("Time (min),AccX,AccY,AccZ,G(x),G(y),G(z)", "{m:.8f},{x:.4f},{y:.4f},{z:.4f},{x:.4f},{y:.4f},{z:.4f}", ""),
        ("timestamp,AccX,AccY,AccZ,Time", "{t:.2f},{x:.4f},{y:.4f},{z:.4f},0.02{d}", ""),
        ("time,acc_x,acc_y,acc_z,acc_x_ema,acc_y_ema,acc_z_ema", "{t:.2f},{x:.4f},{y:.4f},{z:.4f},{x:.4f},{y:.4f},{z:.4f}",
         ""),
        ("time,accX,accY,accZ,position_x,position_y,position_z", "{t:.2f},{x:.4f},{y:.4f},{z:.4f},{x:.4f},{y:.4f},{z:.4f}",
         ""),
        # A reading is no label of a sensor, and an activity lasts; the last cell of most rows is empty.
        ("time,accX,accY,accZ,imu_temp,type,note", '{t:.2f},{x:.4f},{y:.4f},{z:.4f},2{d},{a},""',
         '{t:.2f},{x:.4f},{y:.4f},{z:.4f},20,{a},"in"'),
    ],
)  # fmt: skip
def test_what_loggers_write_needs_no_question(tmp_path, force, header, row, first):
    lines = [
        (first if first and k < 5 else row).format(
            t=k / 50, m=k / 3000, h=k / 180000, x=x, y=y, z=z, d=k % 3, a=("rest", "turn")[k // 150]
        )
        for k, (x, y, z) in enumerate(force.tolist())
    ]
    (tmp_path / "log.csv").write_text("\n".join([header, *lines]) + "\n")
    recording = read_recording(tmp_path / "log.csv")
    assert recording.rows == 300 and recording.rate_hz == pytest.approx(50.0, rel=0.01)
    np.testing.assert_allclose(recording.frame().select("^a[xyz].*$").collect().to_numpy(), force, atol=1e-4)
    assert recording.layout.columns["ax"].name == header.split(",")[1] and "gx" not in recording.layout.columns


@pytest.mark.parametrize("system", ["elapsed-time-system", "Timestamp"])
def test_of_two_clocks_the_one_with_regular_steps_is_used(tmp_path, force, system):
    """The clock of the system that receives samples in batches, or in whole seconds, is not that of the sensor."""
    sensor = "elapsed-time-sensor" if system != "Timestamp" else "Milliseconds"
    times = np.arange(300) / 50
    late = [f"2026-03-29 10:00:0{t:.0f}" for t in np.floor(times)] if system == "Timestamp" else np.ceil(times * 7) / 7
    own = times if sensor != "Milliseconds" else times * 1000
    rows = [f"{a},{b:.6g},{x:.5f},{y:.5f},{z:.5f}" for a, b, (x, y, z) in zip(late, own, force.tolist(), strict=True)]
    (tmp_path / "log.csv").write_text("\n".join([f"{system},{sensor},x,y,z", *rows]) + "\n")
    recording = read_recording(tmp_path / "log.csv")
    assert recording.layout.columns["time"].name == sensor and recording.rate_hz == pytest.approx(50.0)
    words = f"clock: {sensor}, not {system}; to override: --columns time={system}"
    assert words in recording.layout.notes
    chosen = read_recording(tmp_path / "log.csv", columns=f"time={system}")
    assert chosen.layout.columns["time"].name == system


def test_rows_of_another_sensor_have_no_cells_and_are_left_out(tmp_path, force):
    """Three of four rows have only the cell of another sensor."""
    rows = [
        f"{20 * k},{x:.4f},{y:.4f},{z:.4f}," if k % 4 == 0 else f"{20 * k},,,,{k % 7}.5"
        for k, (x, y, z) in enumerate(force.tolist())
    ]
    (tmp_path / "log.csv").write_text("\n".join(["time_ms,AccX,AccY,AccZ,Light", *rows]) + "\n")
    recording = read_recording(tmp_path / "log.csv")
    assert (recording.rows, recording.unread.rows) == (75, 225) and recording.rate_hz == pytest.approx(12.5)
    (tmp_path / "log.csv").write_text(
        "\n".join(["time_ms,AccX,AccY,AccZ,Light", *rows]).replace(",,,", ",no,no,") + "\n"
    )
    with pytest.raises(InputError, match=r"line 3: .* rows cannot be read as AccX, AccY, AccZ"):
        read_recording(tmp_path / "log.csv")


def test_millimetres_a_second_squared_are_no_counts(tmp_path, force):
    log = text(tmp_path / "log.csv", "time,accX,accY,accZ", np.column_stack([np.arange(300) / 400, 9780 * force]))
    assert read_recording(log).layout.per_g is None
