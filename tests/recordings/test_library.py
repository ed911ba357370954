"""Recordings in Python: samples, means and a calibration over temperature without the command line."""

import gc
import json

import numpy as np
import polars as pl
import pytest
from recordings_made import faces_in_turn

import tumblecal


def log(path, force):
    """A log of readings (n, 3) in counts of 2048 a g at 50 Hz."""
    counts = np.round(2048 * force)
    pl.DataFrame(
        {"t_s": np.arange(len(force)) / 50, **{f"raw_a{a}": counts[:, k] for k, a in enumerate("xyz")}}
    ).write_csv(path)
    return path


@pytest.fixture
def faces():
    return faces_in_turn()


def test_a_recording_has_its_samples_and_their_evidence_until_it_is_dropped(tmp_path, faces):
    recording = tumblecal.read_recording(log(tmp_path / "log.csv", faces))
    assert (recording.rows, recording.layout.per_g) == (len(faces), 2048)
    assert recording.rate_hz == pytest.approx(50)
    np.testing.assert_array_equal(
        recording.frame().select("ax_counts").collect().to_series(), np.round(2048 * faces[:, 0])
    )
    samples = recording.samples
    del recording
    gc.collect()
    assert not samples.exists()


def test_means_are_those_of_the_command(tmp_path, faces, tumblecal):
    import tumblecal as library

    path = log(tmp_path / "log.csv", faces)
    data = library.reduce(path, static=True, run="7")
    assert tumblecal("reduce", path, "--static", "--run", "7", "--out", tmp_path / "r", "--no-figures").code == 0
    written = library.read_positions(tmp_path / "r" / "positions.csv")
    np.testing.assert_allclose(data.readings, written.readings, rtol=1e-12)
    assert data.run == written.run == ("7",) * 6


def test_the_description_reads_the_recording_as_it_was_described(tmp_path, faces, tumblecal):
    path = log(tmp_path / "log.csv", faces)
    outcome = tumblecal("import", path, "--unit", "2000/g", "--out", tmp_path / "s.parquet", "--json")
    described = tmp_path / "log.csv.recording.toml"
    assert json.loads(outcome.out.splitlines()[-1])["accelerations"]["counts_per_g"] == 2000
    import tumblecal as library

    recording = library.read_recording(described)
    assert recording.layout.per_g == 2000 and recording.path == path
    assert library.read_recording(described, unit="2048/g").layout.per_g == 2048
    for text, words in (
        (described.read_text().replace("file =", 'colour = "red"\nfile ='), "colour: unknown key"),
        (described.read_text().replace("file =", "files ="), "needs schema = 'tumblecal.recording/1' and file ="),
        ("file = ", "not TOML"),
    ):
        described.write_text(text)
        with pytest.raises(library.InputError, match=words):
            library.read_recording(described)
    # The source of a unit is a field of its column, and of the description.
    assert tumblecal("import", path, "--out", tmp_path / "s.parquet").code == 0
    columns = library.read_recording(path).layout.columns
    assert (columns["ax"].why, columns["ax"].unit_why, columns["time"].unit_why) == ("name", "size", "file")
    assert 'unit = "size"\ntime_unit = "file"' in described.read_text().partition("[source]")[2]
    path.write_text("sampled at 100 Hz\nax,ay,az\n" + "0.1,0.2,0.97\n" * 40)
    assert tumblecal("import", path, "--out", tmp_path / "s.parquet").code == 0
    assert "rate = 100" in described.read_text() and library.read_recording(described).rate_hz == 100
