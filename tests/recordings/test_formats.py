"""Each format gives the arrays that a library wrote; damage is reported or is one line, and no other file is read."""

import gzip
import json

import numpy as np
import polars as pl
import pytest
from recordings_made import hdf5

import damaged_made as made
from tumblecal.ground.errors import InputError
from tumblecal.recordings.damage import Damage
from tumblecal.recordings.formats import tables_of
from tumblecal.recordings.options import RecordingOptions


SAMPLES = made.samples()
ROWS = [dict(zip(SAMPLES, map(float, row), strict=True)) for row in zip(*SAMPLES.values(), strict=True)]
FORCE = np.stack([SAMPLES[f"acc_{axis}"] for axis in "xyz"], axis=1)


def read(path, content=None, name=None):
    """The table of a file with this name, its rows, and the lines of damage."""
    if content is not None:
        path.write_bytes(content)
    damage = Damage()
    tables = {table.name: table for table in tables_of(path, RecordingOptions(), damage)[1]}
    table = tables[name] if name is not None else next(iter(tables.values()))
    return table, pl.concat(table.pieces(table.columns)), damage.lines


def lines_of(rows):
    return "".join(f"{json.dumps(row)}\n" for row in rows).encode()


def numpy_archive(path):
    np.savez_compressed(path, **SAMPLES)


def parquet(path):
    pl.DataFrame(SAMPLES).write_parquet(path)


def matlab_struct(path):
    from scipy.io import savemat

    savemat(path, {"log": {"own": SAMPLES, "label": "abc"}})


def matlab_73(path):
    hdf5(path, SAMPLES, matlab=True)


WRITTEN = {
    "log.npz": numpy_archive,
    "log.parquet": parquet,
    "log.mat": matlab_struct,
    "log73.mat": matlab_73,
    "log5.mat": made.matlab(compressed=True),
    "log.h5": made.hdf5(checked=True),
    "log.xlsx": made.spreadsheet(),
    "log.json.gz": gzip.compress(lines_of(ROWS)),
    "log.xlsx.gz": gzip.compress(made.spreadsheet()),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_arrays_under_their_own_names(tmp_path, name):
    written = WRITTEN[name]
    content = written if isinstance(written, bytes) else written(tmp_path / name)
    table, rows, lines = read(tmp_path / name, content)
    assert {*SAMPLES} == {*table.columns} and not lines
    for column, values in SAMPLES.items():
        np.testing.assert_allclose(rows[column], values, atol=6e-7)


def _cut(content):
    return content[: len(content) * 2 // 3 + 5]


def _changed(content):
    """A byte in the middle of the samples is different."""
    return content[: len(content) // 2] + bytes([content[len(content) // 2] ^ 0x55]) + content[len(content) // 2 + 1 :]


@pytest.mark.parametrize("damage", [bytes, _cut, _changed])
def test_frames_of_a_mimu_log(tmp_path, damage):
    """Counts, with those for one g; bytes outside complete frames are reported."""
    table, rows, lines = read(tmp_path / "mimu.bin", damage(made.mimu()))
    columns = {role: column for column, role in table.roles.items()}
    if damage is bytes:
        force = rows.select(columns[f"a{axis}_counts"] for axis in "xyz").to_numpy()
        np.testing.assert_allclose(force, table.per_unit["a"] * FORCE / made.G, atol=0.51)
        np.testing.assert_allclose(np.diff(rows[columns["time_s"]].cast(pl.Float64)), 0.02, atol=1e-6)
    assert 390 <= len(rows) <= 600
    assert [("bytes are outside complete frames" in line) for line in lines] == [True] * (damage is not bytes)


@pytest.mark.parametrize("damage", [_cut, _changed])
@pytest.mark.parametrize("name", ["log.mcap", "log.h5", "log5.mat", "log.xlsx", "log.json.gz", "log.npz"])
def test_a_wrong_checksum_or_a_missing_end_is_one_line(tmp_path, name, damage):
    path = tmp_path / name
    written = made.with_mcap_checks(made.ros2_bag(mcap=True)) if name == "log.mcap" else WRITTEN[name]
    if not isinstance(written, bytes):
        written(path)
        written = path.read_bytes()
    with pytest.raises(InputError, match=name) as refused:
        read(path, damage(written))
    assert len(refused.value.faults) == 1 and str(tmp_path) in str(refused.value)
