"""Damaged rows are left out and reported, or asked about; sound recordings pass unchanged. The truth is the sound table."""

from collections.abc import Iterator

import numpy as np
import polars as pl
import pytest
from recordings_made import ATTITUDES

from hand_held_sessions import Hand, session
from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording


RATE_HZ = 100.0
AXES, NAMES = ("ax_g", "ay_g", "az_g"), ("ax", "ay", "az")
ERASED = {
    "all bits set": (4294967.295, -1 / 16384),
    "zeros": (0.0, 0.0),
    "clock stays": (None, 0.7),
    "no number": (np.nan, np.nan),
    "a number beyond all": (3.4e38, 3.4e38),
}


def forces(rate_hz: float = RATE_HZ, offset_g: float = 0.0, sigma_g: float = 1e-3) -> np.ndarray:
    """Accelerations in g (n, 3) of eight attitudes and the turns between them."""
    force = session(3, ATTITUDES, Hand(rate_hz=rate_hz, sigma_g=sigma_g, dwell_s=(1.7, 2.2))).force
    return force + offset_g * np.array([1.0, -1.0, 0.5])


def table(force: np.ndarray, rate_hz: float = RATE_HZ, names: tuple[str, ...] = AXES) -> dict[str, np.ndarray]:
    """Columns of a recording with times in s."""
    return {"time_s": np.arange(len(force)) / rate_hz, **dict(zip(names, force.T, strict=True))}


def rows(columns: dict[str, np.ndarray], which: np.ndarray) -> dict[str, np.ndarray]:
    """Some rows of all columns."""
    return {name: values[which] for name, values in columns.items()}


def with_erased(columns: dict[str, np.ndarray], kind: str, at: int, count: int) -> dict[str, np.ndarray]:
    """Rows of erased memory before row `at`."""
    time, reading = ERASED[kind]
    damaged = {}
    for name, values in columns.items():
        number = reading if name != "time_s" else values[max(at - 1, 0)] if time is None else time
        damaged[name] = np.insert(values, at, np.full(count, number))
    return damaged


def orders(count: int) -> Iterator[tuple[str, int, np.ndarray]]:
    """What was done, how many rows were moved, and the rows in the order of the file."""
    own = np.arange(count)
    swapped = own.copy()
    first = np.arange(5, count - 2, count // 20)
    swapped[first], swapped[first + 1] = own[first + 1], own[first]
    yield "neighbours exchanged", len(first), swapped
    yield "packets exchanged", 10, np.concatenate([own[:500], own[510:520], own[500:510], own[520:]])
    yield "first packets exchanged", 10, np.concatenate([own[10:20], own[:10], own[20:]])
    yield "a late row", 1, np.concatenate([own[:500], own[501:700], own[500:501], own[700:]])
    yield "halves exchanged", count // 3, np.concatenate([own[count // 3 :], own[: count // 3]])


def read(tmp_path, columns, options=RecordingOptions()):
    """The samples as they are written, (n, columns), and the recording."""
    path, out = tmp_path / "log.parquet", tmp_path / "samples.parquet"
    pl.DataFrame(columns).write_parquet(path)
    recording = read_recording(path, out, options)
    return pl.read_parquet(out).to_numpy(), recording


def records(recording):
    return [(record.kind, record.rows) for record in recording.damage.records]


def whole(columns):
    return np.stack(list(columns.values()), axis=1)


@pytest.mark.parametrize(
    ("bits", "per_g", "count", "stated"),
    [(16, 16384, None, ""), (16, 8192, 150, ""), (8, 64, None, ""), (16, 16384, None, "16384/g"), (12, 512, None, "")],
)
def test_negative_numbers_written_as_unsigned_ones_are_a_question_whose_answer_reads_them(
    tmp_path, bits, per_g, count, stated
):
    steps = np.round(forces(offset_g=0.3) * per_g)[50 : 50 + count if count else None]
    written = np.where(steps < 0, steps + 2**bits, steps)
    with pytest.raises(InputError, match=f"--signed {bits} --unit {per_g}/g"):
        read(tmp_path, table(written, names=NAMES), RecordingOptions(unit=stated))
    got, recording = read(tmp_path, table(written, names=NAMES), RecordingOptions(signed=bits, unit=f"{per_g}/g"))
    np.testing.assert_array_equal(got[:, 1:], steps)
    assert recording.layout.per_g == per_g and not recording.damage.lines


@pytest.mark.parametrize("kind", ERASED)
def test_rows_of_erased_memory_are_left_out(tmp_path, kind):
    columns = table(np.round(forces(), 5))
    count = len(columns["time_s"])
    for at in (count, count // 2, 0):
        got, recording = read(tmp_path, with_erased(columns, kind, at, 2 * count))
        np.testing.assert_allclose(got, whole(columns), atol=1e-9)
        if kind in ("no number", "a number beyond all"):
            assert recording.unread.rows == 2 * count and recording.unread.first[0] == at + 1
        else:
            assert records(recording) == [("erased", 2 * count)] and recording.damage.records[0].first_row == at + 1
        assert recording.rate_hz == pytest.approx(RATE_HZ)


def test_late_rows_are_left_out_and_a_clock_that_restarts_is_kept(tmp_path):
    columns = table(np.round(forces(), 5))
    for what, _, order in orders(len(columns["time_s"])):
        got, recording = read(tmp_path, rows(columns, order))
        time = columns["time_s"][order]
        expected = np.ones(len(order), bool) if what == "halves exchanged" else time >= np.maximum.accumulate(time)
        np.testing.assert_allclose(got[:, 1:], whole(columns)[order][expected, 1:], atol=1e-9, err_msg=what)
        count = int((~expected).sum())
        assert records(recording) == ([("disorder", count)] if count else []), what


@pytest.mark.parametrize(("times", "per_g"), [(2, 1e5), (7, 64), (3.25, 1e5)])
def test_one_of_each_repeated_sample_is_kept(tmp_path, times, per_g):
    force = np.round(forces() * per_g) / per_g
    sample = np.floor(np.arange(int(len(force) * times)) / times).astype(int)
    columns = table(force[sample])
    got, recording = read(tmp_path, columns)
    assert len(got) == pytest.approx(len(force), rel=0.01)
    assert recording.rate_hz == pytest.approx(RATE_HZ / times, rel=0.01)
    (record,) = recording.damage.records
    assert (record.kind, record.rows) == ("repeats", len(columns["time_s"]) - len(got))
    assert record.largest == pytest.approx(times, rel=0.01)
    # Without times, the stated rate is that of the rows.
    _, recording = read(tmp_path, {name: columns[name] for name in AXES}, RecordingOptions(rate=RATE_HZ))
    assert recording.rate_hz == pytest.approx(RATE_HZ / times, rel=0.01)


def sound(rate_hz):
    """Recordings that are not damaged, however unusual: name, columns, options."""
    rng, options = np.random.default_rng(4), RecordingOptions()
    for offset_g, sigma_g in ((0.0, 1e-4), (0.6, 1e-3)):
        force = forces(rate_hz, offset_g, sigma_g)
        coarse, counts = np.round(force * 64) / 64, np.round(force * 2048)
        times = np.arange(len(force)) / rate_hz
        clocks = {
            "regular": times,
            "jitter": np.maximum.accumulate(times + 0.4 / rate_hz * rng.normal(size=len(times))),
            "whole ms": np.round(times, 3),
            "packets": times[np.minimum(np.arange(len(times)) // 32 * 32 + 31, len(times) - 1)],
        }
        for clock, clock_s in clocks.items():
            yield f"{offset_g} {clock}", table(coarse) | {"time_s": clock_s}, options
        yield f"{offset_g} saturated", table(np.clip(coarse, -0.5, 0.5), rate_hz), options
        yield f"{offset_g} fine", table(force, rate_hz), options
        yield f"{offset_g} unsigned", table(counts + 32768, rate_hz, NAMES), options
        stated = RecordingOptions(offset="32768", unit="2048/g")
        yield f"{offset_g} unsigned, stated", table(counts + 32768, rate_hz, NAMES), stated
        yield f"{offset_g} 10 bits", table(np.round(force * 102) + 512, rate_hz, NAMES), options
    faces = np.repeat(np.vstack([np.eye(3), -np.eye(3)]), 100, axis=0) + 1e-3 * rng.normal(size=(600, 3))
    for name, face in {"six": faces, "one": faces[200:300], "two": faces[[*range(200, 300), *range(500, 600)]]}.items():
        yield f"faces {name}", table(np.round(face * 256), names=NAMES), RecordingOptions(unit="256/g")


@pytest.mark.parametrize(
    "rate_hz", [100.0, *(pytest.param(rate_hz, marks=pytest.mark.long) for rate_hz in (20.0, 2000.0))]
)
def test_sound_recordings_pass_unchanged(tmp_path, rate_hz):
    for name, columns, options in sound(rate_hz):
        got, recording = read(tmp_path, columns, options)
        assert not recording.damage.lines, (name, recording.damage.lines)
        offset = float(options.offset or 0)
        np.testing.assert_array_equal(got[:, 1:], whole(columns)[:, 1:] - offset, err_msg=name)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_apply_leaves_out_rows_without_a_reading_and_lists_them(tmp_path, tumblecal, suffix):
    """The corrected file is the formula on the other rows, with all columns of the source."""
    matrix, bias = np.diag([1.01, 0.99, 1.02]), np.array([0.02, -0.03, 0.05])
    write_calibration(tmp_path / "cal.json", Calibration(matrix, bias, np.zeros((12, 12))))
    path, out = tmp_path / f"log{suffix}", tmp_path / f"out{suffix}"
    names = tuple(f"acc_{axis} [g]" for axis in "xyz")
    columns = table(np.round(forces()[:1200], 5), names=names) | {"note": np.arange(1200.0)}
    truth = whole(columns)
    truth[:, 1:4] = (truth[:, 1:4] - bias) @ matrix.T
    frame = pl.DataFrame(with_erased(columns, "no number", 600, 1200))
    frame.write_parquet(path) if suffix == ".parquet" else frame.write_csv(path)
    outcome = tumblecal("apply", tmp_path / "cal.json", path, "--out", out)
    assert outcome.code == 0, outcome.lines
    read_table = pl.read_parquet if suffix == ".parquet" else lambda file: pl.read_csv(file, comment_prefix="#")
    got = read_table(out).select("time_s", "ax_g", "ay_g", "az_g", "note").to_numpy()
    np.testing.assert_allclose(got, truth, atol=1e-9)
    places = "rows 601 to 1800" if suffix == ".parquet" else "lines 602 to 1801"
    assert f"left out: {places}" in outcome.out
    assert places in (str(pl.read_parquet_metadata(out)) if suffix == ".parquet" else out.read_text())
