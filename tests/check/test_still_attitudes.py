"""The attitudes of a check, from recordings of every form: one log, a column, several files, tables of means, directories."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from recordings_made import FACES, faces_in_turn

from tumblecal import InputError
from tumblecal.check.attitudes import directions_of, still_attitudes
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


def log(path: Path, force, **more) -> Path:
    columns = {"time_s": np.arange(len(force)) / 50, **{f"a{axis}_g": force[:, k] for k, axis in enumerate("xyz")}}
    pl.DataFrame(columns | more).write_csv(path)
    return path


def attitudes(files, context=KnownContext(), options=RecordingOptions()):
    return still_attitudes(files, context, options, Criterion())


def test_a_log_has_the_attitudes_of_its_intervals_at_rest(tmp_path):
    found = attitudes([log(tmp_path / "log.csv", faces_in_turn(FACES))])
    assert directions_of(found) == 6 and found.data.hand_held
    np.testing.assert_allclose(found.data.readings, FACES, atol=1e-3)
    assert found.dwells.still_s == pytest.approx(24, abs=4) and found.dwells.stillness is not None


def test_a_column_or_the_files_name_the_attitudes(tmp_path):
    at_rest = np.repeat(FACES, 100, axis=0) + 1e-3 * np.random.default_rng(1).normal(size=(600, 3))
    parts = [f"face {k}" for k in np.repeat(np.arange(6), 100)]
    by_column = attitudes(
        [log(tmp_path / "log.csv", at_rest, part=parts)], KnownContext(by="part", static=True, run="7", mount="B")
    )
    assert by_column.data.run == ("7",) * 6 and by_column.data.mount == ("B",) * 6
    files = [log(tmp_path / f"face{k}.csv", at_rest[100 * k : 100 * k + 100]) for k in range(6)]
    by_files = attitudes(files)
    for found in (by_column, by_files):
        np.testing.assert_allclose(found.data.readings, FACES, atol=1e-3)
    assert len(by_files.dwells.files) == 6 and by_files.dwells.lines


def test_rows_of_means_are_taken_as_they_are(tmp_path):
    means = pl.DataFrame({"X": FACES[:, 0], "Y": FACES[:, 1], "Z": FACES[:, 2]})
    means.write_csv(tmp_path / "means.csv")
    options = RecordingOptions(columns="ax=X,ay=Y,az=Z", unit="g")
    found = attitudes([tmp_path / "means.csv"], KnownContext(means=True), options)
    np.testing.assert_array_equal(found.data.readings, FACES)
    assert found.data.hand_held and found.dwells.still_s is None and not found.data.in_ms2


def test_too_few_attitudes_and_kelvin_are_one_line(tmp_path):
    with pytest.raises(InputError, match="only 2 attitudes"):
        attitudes([log(tmp_path / "two.csv", faces_in_turn(FACES[:2]))])
    force = faces_in_turn(FACES)
    with pytest.raises(InputError, match="are in kelvin"):
        attitudes([log(tmp_path / "warm.csv", force, temperature_degc=np.full(len(force), 298.0))])
