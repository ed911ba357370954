"""Damaged samples are corrected or left out, and reported; healthy recordings pass unchanged. The truth is the sound table."""

import numpy as np
import polars as pl
import pytest
from damaged_rows import AXES, ERASED, RATE_HZ, forces, orders, rows, table, with_erased

from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.rows.sample_file import write_samples
from tumblecal.data.calibration import Calibration, write_calibration


NAMES = ("ax", "ay", "az")


def read(tmp_path, columns, options=RecordingOptions()):
    """The samples as they are written, (n, columns), and the contents."""
    path, out = tmp_path / "log.parquet", tmp_path / "samples.parquet"
    pl.DataFrame(columns).write_parquet(path)
    contents = write_samples(path, out, options)
    return pl.read_parquet(out).to_numpy(), contents


def records(contents):
    return [(record.kind, record.action, record.rows) for record in contents.damage.records]


def whole(columns):
    return np.stack(list(columns.values()), axis=1)


# Bits, steps of one g, and the number written of a step with so many digits.
TYPES = {
    "int16": (16, 16384, 1.0, 0),
    "int8": (8, 64, 1.0, 0),
    "12 bits, left-justified": (12, 1024, 16.0, 0),
    "g, three digits": (16, 16384, 1 / 16384, 3),
    "m/s^2": (16, 4096, 9.80665 / 4096, 4),
}


@pytest.mark.parametrize("name", TYPES)
def test_negative_numbers_written_as_unsigned_are_read_as_negative(tmp_path, name):
    bits, per_g, step, digits = TYPES[name]
    steps = np.round(forces(offset_g=0.6) * per_g)
    unit = {"g": "g", "m": "m/s2"}.get(name[0], f"{per_g * step:g}/g")
    written = np.round(np.where(steps < 0, steps + 2**bits, steps) * step, digits)
    got, contents = read(tmp_path, table(written, names=NAMES), RecordingOptions(unit=unit))
    np.testing.assert_allclose(got[:, 1:], np.round(steps * step, digits), atol=2.01 * 10**-digits * (digits > 0))
    assert records(contents) == [("unsigned", "corrected", np.count_nonzero((steps < 0).any(axis=1)))]
    assert contents.damage.records[0].largest == pytest.approx(2**bits * step, abs=2 * 10**-digits)
    # The same numbers as they should be pass unchanged.
    got, contents = read(tmp_path, table(np.round(steps * step, digits), names=NAMES), RecordingOptions(unit=unit))
    np.testing.assert_array_equal(got[:, 1:], np.round(steps * step, digits))
    assert not contents.damage.lines


@pytest.mark.parametrize("kind", ERASED)
def test_rows_of_erased_memory_are_left_out(tmp_path, kind):
    columns = table(np.round(forces(), 5))
    count = len(columns["time_s"])
    for at in (count, count // 2, 0):
        got, contents = read(tmp_path, with_erased(columns, kind, at, 2 * count))
        np.testing.assert_allclose(got, whole(columns), atol=1e-9)
        assert records(contents) == [("erased", "left out", 2 * count)]
        assert contents.damage.records[0].first_row == at + 1
        assert contents.rate_hz == pytest.approx(RATE_HZ)


def test_rows_out_of_order_are_sorted(tmp_path):
    columns = table(np.round(forces(), 5))
    for what, moved, order in orders(len(columns["time_s"])):
        got, contents = read(tmp_path, rows(columns, order))
        np.testing.assert_allclose(got, whole(columns), atol=1e-9, err_msg=what)
        assert records(contents) == [("disorder", "sorted", moved)], what


def test_rows_without_a_place_are_left_out_and_rows_that_came_twice_too(tmp_path):
    columns = table(np.round(forces(), 5))
    count = len(columns["time_s"])
    spiked = columns | {"time_s": np.where(np.arange(count) == 300, 4294967.295, columns["time_s"])}
    got, contents = read(tmp_path, spiked)
    np.testing.assert_allclose(got, np.delete(whole(columns), 300, axis=0), atol=1e-9)
    assert records(contents) == [("disorder", "left out", 1)]
    assert contents.missing == 1
    packet = np.concatenate([np.arange(500), np.arange(480, count)])
    single = np.sort(np.concatenate([np.arange(count), np.arange(7, count, 90)]))
    for order in (packet, single):
        got, contents = read(tmp_path, rows(columns, order))
        np.testing.assert_allclose(got, whole(columns), atol=1e-9)
        assert records(contents) == [("duplicates", "left out", len(order) - count)]


@pytest.mark.parametrize(("times", "per_g"), [(2, 1e5), (7, 64), (3.25, 1e5)])
def test_one_of_each_repeated_sample_is_kept(tmp_path, times, per_g):
    force = np.round(forces() * per_g) / per_g
    sample = np.floor(np.arange(int(len(force) * times)) / times).astype(int)
    columns = table(force[sample])
    got, contents = read(tmp_path, columns)
    assert len(got) == pytest.approx(len(force), rel=0.002)
    assert contents.rate_hz == pytest.approx(RATE_HZ / times, rel=0.002)
    if times != 3.25:
        np.testing.assert_array_equal(got[:, 1:], force)
    (record,) = contents.damage.records
    assert (record.kind, record.rows) == ("repeats", len(columns["time_s"]) - len(got))
    assert record.largest == pytest.approx(times, rel=0.01)
    # Without times, the stated rate is that of the rows.
    got, contents = read(tmp_path, {name: columns[name] for name in AXES}, RecordingOptions(rate=RATE_HZ))
    assert contents.rate_hz == pytest.approx(RATE_HZ / times, rel=0.01)
    # The logger may repeat the time as well.
    got, contents = read(tmp_path, rows(table(force), sample))
    assert contents.rate_hz == pytest.approx(RATE_HZ, rel=0.002)
    assert records(contents)[0][0] == "repeats"


def healthy(rate_hz):
    """Recordings that are not damaged, however odd: name, columns, what is asked."""
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
        for clock, own in clocks.items():
            yield f"{offset_g} {clock}", table(coarse) | {"time_s": own}, options
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
def test_healthy_recordings_pass_unchanged(tmp_path, rate_hz):
    for name, columns, options in healthy(rate_hz):
        got, contents = read(tmp_path, columns, options)
        assert not contents.damage.lines, (name, contents.damage.lines)
        assert len(got) == len(columns["time_s"]), name
        offset = float(options.offset or 0)
        np.testing.assert_array_equal(got[:, 1:], whole(columns)[:, 1:] - offset, err_msg=name)


@pytest.mark.parametrize(
    ("suffix", "names"), [(".csv", AXES), (".parquet", tuple(f"acc_{axis} [g]" for axis in "xyz"))]
)
def test_apply_leaves_erased_rows_out_and_reports_other_damage(tmp_path, tumblecal, names, suffix):
    """The corrected file is the formula on the sound rows; it says which others were left out, and keeps those out of order."""
    matrix, bias = np.diag([1.01, 0.99, 1.02]), np.array([0.02, -0.03, 0.05])
    write_calibration(tmp_path / "cal.json", Calibration(matrix, bias, np.zeros((12, 12))))
    path, out = tmp_path / f"log{suffix}", tmp_path / f"out{suffix}"
    columns = table(np.round(forces()[:1200], 5), names=names) | {"note": np.arange(1200.0)}
    read = pl.read_parquet if suffix == ".parquet" else lambda own: pl.read_csv(own, comment_prefix="#")

    def applied(damaged):
        frame = pl.DataFrame(damaged)
        frame.write_parquet(path) if suffix == ".parquet" else frame.write_csv(path)
        outcome = tumblecal("apply", tmp_path / "cal.json", path, "--out", out)
        assert outcome.code == 0, outcome.lines
        return outcome, read(out).select("time_s", "ax_g", "ay_g", "az_g", "note").to_numpy()

    truth = whole(columns)
    truth[:, 1:4] = (truth[:, 1:4] - bias) @ matrix.T
    outcome, got = applied(columns)
    np.testing.assert_allclose(got, truth, atol=1e-9)
    assert not outcome.lines and "left out" not in outcome.out
    outcome, got = applied(with_erased(columns, "zeros", 600, 1200))
    np.testing.assert_allclose(got, truth, atol=1e-9)
    assert any("1200 rows of erased memory, first row 601" in line for line in outcome.lines)
    places = "rows 601 to 1800" if suffix == ".parquet" else "lines 602 to 1801"
    assert f"left out: {places}" in outcome.out
    comments = str(pl.read_parquet_metadata(out)) if suffix == ".parquet" else out.read_text()
    assert places in comments
    for what, moved, order in orders(1200):
        outcome, got = applied(rows(columns, order))
        np.testing.assert_allclose(got[:, 1:], truth[order, 1:], atol=1e-9, err_msg=what)
        assert any(f"{moved} row" in line and "the rows are not changed" in line for line in outcome.lines), what
    twice = rows(columns, np.repeat(np.arange(1200), 2)) | {"time_s": np.arange(2400) / 200}
    assert any("each sample is written 2 times" in line for line in applied(twice)[0].lines)


def test_overflowed_numbers_come_back(tmp_path):
    steps = np.round(forces(offset_g=0.3) * 110)
    written = (steps + 128) % 256 - 128
    assert (written != steps).any()
    got, contents = read(tmp_path, table(written, names=NAMES), RecordingOptions(unit="110/g"))
    np.testing.assert_array_equal(got[:, 1:], steps)
    assert records(contents) == [("overflow", "corrected", np.count_nonzero((written != steps).any(axis=1)))]


def test_a_range_that_only_later_rows_show_is_found(tmp_path):
    still = np.tile(np.round([[330.0, 500.0, 16380.0]]), (300_000, 1)) + np.arange(300_000)[:, None] % 5
    steps = np.concatenate([still, np.round(forces() * 16384)])
    written = np.where(steps < 0, steps + 65536, steps)
    got, contents = read(tmp_path, table(written, names=NAMES), RecordingOptions(unit="16384/g"))
    np.testing.assert_array_equal(got[:, 1:], steps)
    assert [record.kind for record in contents.damage.records] == ["unsigned"]


def test_angular_rates_written_as_unsigned(tmp_path):
    rates = np.round(np.random.default_rng(2).normal(0, 20, (len(forces()), 3)))
    written = np.where(rates < 0, rates + 65536, rates)
    columns = table(np.round(forces(), 5)) | {f"gyr_{axis}": own for axis, own in zip("xyz", written.T, strict=True)}
    got, contents = read(tmp_path, columns)
    np.testing.assert_array_equal(got[:, 4:], rates)
    assert records(contents)[0][0] == "unsigned"


def test_the_unit_is_guessed_of_the_numbers_as_they_are_meant(tmp_path):
    steps = np.round(forces() * 8192)
    for written in (steps, steps[50:150]):
        unsigned = np.where(written < 0, written + 65536, written)
        got, contents = read(tmp_path, table(unsigned, names=NAMES))
        np.testing.assert_array_equal(got[:, 1:], written)
        assert contents.layout.per_g == 8192
        assert len(contents.damage.lines) == bool((written < 0).any())


def test_one_attitude_is_read_as_signed_where_its_size_says_so(tmp_path):
    written = np.round(forces()[-150:] * 16384)[:100] * [1, -1, 1]
    unsigned = np.where(written < 0, written + 65536, written)
    assert (np.abs(np.diff(unsigned, axis=0)) < 1000).all() and (written[:, 1] < 0).all()
    got, contents = read(tmp_path, table(unsigned, names=NAMES))
    np.testing.assert_array_equal(got[:, 1:], written)
    assert records(contents)[0][0] == "unsigned"
