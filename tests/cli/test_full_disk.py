"""A disk that is full: exit code 2 and one line, whatever was being written; no half of a file is left."""

import resource

import numpy as np
import pytest

from tumblecal.data import write_positions


pytestmark = pytest.mark.usefixtures("few_effects")


# More bytes than this no file may have; less than any result.
ROOM = 100


@pytest.fixture
def files(tmp_path, configs, table1, tumblecal):
    """What the commands read, made before the disk is full."""
    for name in ("table1.csv", "table1.parquet"):
        write_positions(tmp_path / name, table1)
    return {"tmp": tmp_path, "configs": configs, "data": tmp_path / "table1.csv", "calibration": _calibration(tmp_path)}


def _calibration(folder):
    from tumblecal.data.calibration import Calibration, write_calibration

    path = folder / "calibration.json"
    write_calibration(path, Calibration(np.eye(3), np.zeros(3), np.eye(12) * 1e-12))
    return path


@pytest.fixture
def full_disk(tumblecal):
    """A command on a disk with no room."""

    def run(*arguments):
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, hard))
        try:
            return tumblecal(*arguments)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    return run


COMMANDS = {
    "simulate": (["simulate", "{configs}/paper24.toml", "--out", "{tmp}/out.csv"], "out.csv"),
    "simulate to Parquet": (["simulate", "{configs}/paper24.toml", "--out", "{tmp}/out.parquet"], "out.parquet"),
    "apply": (["apply", "{calibration}", "{data}", "--out", "{tmp}/out.csv"], "out.csv"),
    "apply to Parquet": (["apply", "{calibration}", "{tmp}/table1.parquet", "--out", "{tmp}/out.parquet"], "out.parquet"),
    "calibrate": (["calibrate", "{data}", "--out", "{tmp}/out"], "out/result.json"),
    "diagnose": (["diagnose", "{data}", "--out", "{tmp}/out", "--no-figures"], "out/diagnosis.json"),
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "name"), COMMANDS.values(), ids=COMMANDS)
def test_a_full_disk_is_one_line(tumblecal, full_disk, files, arguments, name):
    arguments = [argument.format(**files) for argument in arguments]
    if name.startswith("out/"):
        tumblecal(*arguments, "--out", files["tmp"] / "room")  # what is compiled is kept on this disk, too
    before = {path for path in files["tmp"].rglob("*") if path.is_file()}
    outcome = full_disk(*arguments)
    assert outcome.code == 2
    assert len(outcome.lines) == 1 and name in outcome.lines[0], outcome.lines
    left = {path for path in files["tmp"].rglob("*") if path.is_file()} - before
    assert all(path.stat().st_size < ROOM for path in left), left
