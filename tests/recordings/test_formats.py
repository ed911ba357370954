"""Each format gives the arrays that a library wrote; damage is reported or is one line, and no other file is read."""

import gzip
import json

import numpy as np
import polars as pl
import pytest

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
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in SAMPLES.items():
            file[name] = values[None]
        file["objects"] = np.zeros((600, 1), np.uint32)
        file["objects"].attrs["MATLAB_object_decode"] = 3
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


WRITTEN = {
    "log.npz": numpy_archive,
    "log.parquet": parquet,
    "log.mat": matlab_struct,
    "log73.mat": matlab_73,
    "log5.mat": made.matlab(compressed=True),
    "log.h5": made.hdf5(checked=True),
    "log.xlsx": made.spreadsheet(),
    "lines.json": lines_of(ROWS),
    "list.json": json.dumps(ROWS, indent=1).encode(),
    "listed.json": json.dumps({"rate_hz": 50, "meta": {"device": "a"}, "log": {"samples": ROWS}}).encode(),
    "commas.json": b"[\n" + b",\n".join(lines_of(ROWS).splitlines()) + b"\n]\n",
    "arrays.json": json.dumps({name: values.tolist() for name, values in SAMPLES.items()}).encode(),
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


RECORDED = {
    "log.bin": (made.dataflash(), "ms2"),
    "log.ulg": (made.ulog(), "ms2"),
    "log.bag": (made.ros1_bag(), "ms2"),
    "log.db3": (made.ros2_bag(mcap=False), "ms2"),
    "log.mcap": (made.with_mcap_checks(made.ros2_bag(mcap=True)), "ms2"),
    "log.mtb": (made.mtb(), "g"),
    "mimu.bin": (made.mimu(), "counts"),
}


@pytest.mark.parametrize("name", RECORDED)
def test_roles_that_the_format_defines(tmp_path, name):
    content, unit = RECORDED[name]
    table, rows, lines = read(tmp_path / name, content)
    columns = {role: column for column, role in table.roles.items()}
    force = rows.select(columns[f"a{axis}_{unit}"] for axis in "xyz").to_numpy()
    per_g = table.per_unit.get("a", 1.0)
    expected = FORCE if unit == "ms2" else per_g * FORCE / made.G
    np.testing.assert_allclose(force, expected, atol=0.51 if unit == "counts" else 2e-6)
    (time,) = (column for column, role in table.roles.items() if role.startswith("time"))
    steps = np.diff(rows[time].cast(pl.Float64)) * {"time_us": 1e-6}.get(table.roles[time], 1.0)
    np.testing.assert_allclose(steps, 0.02, atol=1e-6)
    assert not lines


def _zeros(content):
    return content + bytes(100)


def _cut(content):
    return content[: len(content) * 2 // 3 + 5]


def _changed(content):
    """A byte in the middle of the samples is different."""
    return content[: len(content) // 2] + bytes([content[len(content) // 2] ^ 0x55]) + content[len(content) // 2 + 1 :]


@pytest.mark.parametrize(
    ("name", "damage", "words"),
    [
        ("log.bin", _cut, "bytes outside messages, the first at byte"),
        ("log.bin", _zeros, "100 bytes outside messages"),
        ("log.ulg", _cut, "the file ends within a message"),
        ("log.ulg", _zeros, "is not the start of a message"),
        ("log.mtb", _cut, "outside messages with a correct sum"),
        ("log.mtb", _changed, "outside messages with a correct sum"),
        ("mimu.bin", _cut, "bytes are outside complete frames"),
        ("mimu.bin", _changed, "bytes are outside complete frames"),
    ],
)
def test_damage_is_reported_and_sound_rows_are_read(tmp_path, name, damage, words):
    _, rows, lines = read(tmp_path / name, damage(RECORDED[name][0]))
    assert len(lines) == 1 and words in lines[0]
    assert 390 <= len(rows) <= 600


@pytest.mark.parametrize("damage", [_cut, _changed])
@pytest.mark.parametrize("name", ["log.mcap", "log.h5", "log5.mat", "log.xlsx", "log.json.gz", "log.npz"])
def test_a_wrong_checksum_or_a_missing_end_is_one_line(tmp_path, name, damage):
    path = tmp_path / name
    written = WRITTEN[name] if name in WRITTEN else RECORDED[name][0]
    if not isinstance(written, bytes):
        written(path)
        written = path.read_bytes()
    with pytest.raises(InputError, match=name) as refused:
        read(path, damage(written))
    assert len(refused.value.faults) == 1 and str(tmp_path) in str(refused.value)


def test_zeros_that_are_compressed_to_nothing_are_one_line(tmp_path, monkeypatch):
    import tumblecal.recordings.memory as memory

    monkeypatch.setattr(memory, "_BASE", 1_000_000)
    with pytest.raises(InputError, match=r"log\.csv\.gz: its contents need .* decompress it with gunzip"):
        read(tmp_path / "log.csv.gz", gzip.compress(bytes(10_000_000)))


def test_faults_of_a_decompressed_file_name_the_compressed_one(tmp_path):
    with pytest.raises(InputError, match=r"^\S+/log\.json\.gz: not a complete JSON file"):
        read(tmp_path / "log.json.gz", gzip.compress(json.dumps({"samples": ROWS}).encode()[:-20]))


def test_objects_of_several_kinds_are_tables(tmp_path):
    kinds = [{"sensor": kind, "x": k, "y": 0.5, "z": 1} for k in range(20) for kind in ("acc", "gyr")]
    table, rows, _ = read(tmp_path / "log.json", lines_of(kinds), "acc")
    assert table.columns == ("sensor", "acc.x", "acc.y", "acc.z")
    assert rows["acc.x"].to_list() == list(range(20)) and rows["\x00row"].to_list() == list(range(1, 41, 2))


@pytest.mark.parametrize("line", ["garbage", '{"t": 1, "ax": ', "[1, 2]", r'{"t": "\ud83d"}'])
def test_a_line_that_is_no_object_is_a_row_without_values(tmp_path, line):
    lines = [json.dumps({"t": k, "ax": 0.5}) for k in range(50)]
    lines[30] = line
    _, rows, _ = read(tmp_path / "log.json", "\n".join(lines).encode())
    assert len(rows) == 50 and rows.row(30) == (None, None, 31) and rows.row(31) == (31, 0.5, 32)


def test_objects_of_matlab_are_one_line(tmp_path):
    import h5py

    with h5py.File(tmp_path / "log.mat", "w", userblock_size=512) as file:
        file["T"] = np.zeros((1, 6), np.uint32)
        file["T"].attrs["MATLAB_object_decode"] = 3
    with (tmp_path / "log.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    with pytest.raises(InputError, match="write them with writetable or writetimetable"):
        read(tmp_path / "log.mat")


def test_values_of_other_files_and_values_that_are_not_there_are_one_line(tmp_path):
    import h5py

    with h5py.File(tmp_path / "out.h5", "w") as file:
        file.create_dataset("ax", shape=(100,), dtype="f8", external=[(str(tmp_path / "secret"), 0, 800)])
    with pytest.raises(InputError, match="the values of ax are in another file, which is not read"):
        read(tmp_path / "out.h5")
    with h5py.File(tmp_path / "big.h5", "w") as file:
        file.create_dataset("ax", shape=(10**10,), chunks=(1000,), dtype="f8")
    with pytest.raises(InputError, match="80 GB of memory, but the file has 0 MB"):
        read(tmp_path / "big.h5")
