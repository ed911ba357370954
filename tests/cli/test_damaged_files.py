"""Damage that a format can show: sound rows are read and the rest is reported, or the file is refused in one line."""

import json
import zlib

import numpy as np
import polars as pl
import pytest

import damaged_made as made


pytestmark = pytest.mark.usefixtures("few_effects")


CUT_AT = 20_000
# Of a ULog: header and definitions are before the first message of 37 bytes.
MESSAGE = 3 + 34


@pytest.fixture(scope="module")
def ulog() -> bytes:
    return made.ulog()


def test_a_cut_ulog_is_read_to_its_last_whole_message_and_reported(tmp_path, ulog, tumblecal):
    path, before = tmp_path / "log.ulg", len(ulog) - 600 * MESSAGE
    path.write_bytes(ulog[:CUT_AT])
    whole = (CUT_AT - before) // MESSAGE
    told = tumblecal("import", path, "--out", tmp_path / "out.parquet")
    words = f"the file ends within a message (byte {before + whole * MESSAGE} of {CUT_AT}): data after it are missing"
    assert told.code == 0 and told.lines == [f"WARNING: {path}: {words}"]
    force = np.stack([made.samples()[f"acc_{axis}"] for axis in "xyz"], axis=1)[:whole]
    read = pl.read_parquet(tmp_path / "out.parquet").select("ax_ms2", "ay_ms2", "az_ms2").to_numpy()
    np.testing.assert_array_equal(read, force.astype(np.float32))
    reduced = tumblecal("reduce", path, "--static", "--no-figures", "--out", tmp_path / "r")
    assert reduced.lines == told.lines
    content = json.loads((tmp_path / "r" / "reduction.json").read_text())
    assert content["damage"] == [words]
    assert [(own["kind"], own["action"]) for own in content["damage_records"]] == [("format", "reported")]


@pytest.mark.parametrize(("at", "new"), [(5000, b"\0" * 40), (9000, b"\x07\x00\x7f")])
def test_a_ulog_that_is_damaged_within_is_reported(tmp_path, ulog, tumblecal, at, new):
    path = tmp_path / "log.ulg"
    path.write_bytes(ulog[:at] + new + ulog[at + 30 :])
    told = tumblecal("import", path, "--out", tmp_path / "out.parquet")
    assert told.code == 0 and len(told.lines) == 1 and told.lines[0].startswith(f"WARNING: {path}: ")


def _mcap_chunk(content: bytes) -> int:
    return content.index(np.float64(made.samples()["acc_x"][300]).tobytes())


CHECKED = {
    "data.mcap": (lambda: made.with_mcap_checks(made.ros2_bag(mcap=True)), _mcap_chunk, "CRC-32 of its data is wrong"),
    "summary.mcap": (
        lambda: made.with_mcap_checks(made.ros2_bag(mcap=True)),
        lambda content: content.rindex(b"/imu"),
        "CRC-32 of its summary is wrong",
    ),
    "time.db3": (lambda: made.ros2_bag(mcap=False), lambda content: len(content) // 2, "index|malformed|page|row"),
}


@pytest.mark.parametrize("name", CHECKED)
def test_what_has_not_its_checksum_is_refused(tmp_path, tumblecal, name):
    make, place, words = CHECKED[name]
    content, path = bytearray(make()), tmp_path / name
    path.write_bytes(content)
    assert tumblecal("import", path, "--out", tmp_path / "out.parquet").lines == []
    at = place(bytes(content))
    if name == "time.db3":
        content[at : at + 2048] = bytes(2048)
    else:
        content[at] ^= 4
    path.write_bytes(content)
    told = tumblecal("import", path, "--out", tmp_path / "damaged.parquet")
    assert told.code == 2 and len(told.lines) == 1, told
    assert told.lines[0].startswith(f"tumblecal: {path}: not a complete "), told.lines
    assert any(word in told.lines[0] for word in words.split("|")), told.lines
    assert not (tmp_path / "damaged.parquet").exists()


def test_a_flipped_bit_of_a_parquet_file_of_ours_is_refused(tmp_path, tumblecal):
    source, path = tmp_path / "log.csv", tmp_path / "log.parquet"
    source.write_bytes(made.text())
    assert tumblecal("import", source, "--out", path).code == 0
    content = path.read_bytes()
    assert zlib.crc32(content.replace(_checksum(content), b"crc32=00000000")) == int(_checksum(content)[6:], 16)
    rng = np.random.default_rng(3)
    for at, bit in zip(rng.integers(4, len(content), 8), rng.integers(0, 8, 8), strict=True):
        damaged = bytearray(content)
        damaged[at] ^= 1 << bit
        path.write_bytes(damaged)
        told = tumblecal("import", path, "--out", tmp_path / "again.parquet")
        assert told.code == 2 and len(told.lines) == 1, (at, bit, told)
        assert "not a complete Parquet file" in told.lines[0]
    # Another program that rewrites the table keeps the metadata: the checksum is no longer that of the file.
    path.write_bytes(content.replace(b"Polars", b"others").replace(b"imported_from", b"edited_by_all"))
    assert tumblecal("import", path, "--out", tmp_path / "again.parquet").code == 0


def _checksum(content: bytes) -> bytes:
    at = content.rindex(b"crc32=")
    return content[at : at + 14]


def test_a_position_file_cut_in_its_last_number_is_refused(tmp_path, tumblecal):
    content, path = made.positions(), tmp_path / "p.csv"
    words = ("calibrate", path, "--no-figures", "-q", "--out", tmp_path / "c")
    for lost in (2, 8):
        path.write_bytes(content[:-lost])
        told = tumblecal(*words)
        assert told.code == 2 and len(told.lines) == 1 and told.lines[0].startswith(f"tumblecal: {path}:line 25"), told
    path.write_bytes(content)
    tumblecal(*words)
    whole = json.loads((tmp_path / "c" / "calibration.json").read_text())["matrix"]
    # By hand many write no end of the last line.
    path.write_bytes(content[:-1])
    assert tumblecal(*words).code == 0
    assert json.loads((tmp_path / "c" / "calibration.json").read_text())["matrix"] == whole


@pytest.mark.parametrize("lost", [2, 9])
def test_the_cut_last_line_of_a_recording_is_left_out_and_reported(tmp_path, tumblecal, lost):
    content, path = made.text(), tmp_path / "log.csv"
    path.write_bytes(content[:-lost])
    told = tumblecal("import", path, "--out", tmp_path / "out.parquet")
    assert told.code == 0
    assert told.lines == [f"WARNING: {path}: line 601 has no end and may be truncated: left out"]
    assert "1 line left out, without a whole reading: 601" in told.out
    time = pl.read_parquet(tmp_path / "out.parquet")["time_s"].to_numpy()
    np.testing.assert_array_equal(time, made.samples()["time"][:599])
    path.write_bytes(content[:-1])
    told = tumblecal("import", path, "--out", tmp_path / "out.parquet")
    assert told.lines == [] and len(pl.read_parquet(tmp_path / "out.parquet")) == 600
