"""One file, one gravity: every command reads units and `# gravity_ms2` alike, from CSV and Parquet."""

import numpy as np
import polars as pl
import pytest
from capture_folder import PLAN, write_capture

from tumblecal.data import read_positions
from tumblecal.data.raw import read_raw
from tumblecal.ground.gravity import Gravity
from tumblecal.recordings.dwells.by_columns import read_position_samples
from tumblecal.recordings.reduce import reduced


LOCAL, STANDARD = 9.8333, 9.80665
COLUMNS = ("ax_ms2", "ay_ms2", "az_ms2")


def written(path, columns: dict, **comments: str):
    frame = pl.DataFrame(columns)
    if path.suffix == ".parquet":
        frame.write_parquet(path, metadata=comments)
    else:
        path.write_text("".join(f"# {key}: {value}\n" for key, value in comments.items()) + frame.write_csv())
    return path


def positions(path, ms2, **comments: str):
    angles = {
        "position": [f"p{k}" for k in range(len(ms2))],
        "alpha_deg": [0.0] * len(ms2),
        "beta_deg": [0.0] * len(ms2),
    }
    return written(path, angles | dict(zip(COLUMNS, ms2.T, strict=True)), **comments)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_four_commands_read_one_file_alike(tmp_path, suffix):
    """calibrate, apply, diagnose --samples of a table in m/s^2, and reduce of the capture that it came from."""
    alpha, beta = np.radians(np.tile(45.0 * np.arange(8), 3)), np.radians(np.repeat([0.0, 45.0, 90.0], 8))
    readings = np.stack([-np.sin(beta), np.cos(beta) * np.sin(alpha), np.cos(beta) * np.cos(alpha)], axis=-1)
    capture = write_capture(tmp_path / "capture", readings * LOCAL / STANDARD, 1e-4, 1e-6, 100.0)
    plan = PLAN.replace(f"gravity_ms2 = {STANDARD}", f"gravity_ms2 = {LOCAL}")
    assert plan != PLAN
    (capture.folder / "plan.toml").write_text(plan)
    found = reduced([capture.folder]).data
    ms2 = capture.samples * STANDARD
    means = positions(tmp_path / f"means{suffix}", ms2.mean(1), gravity_ms2=str(LOCAL))
    columns = {"position": np.repeat(np.array(found.names), ms2.shape[1]), "time_s": capture.times_s.ravel()}
    columns |= dict(zip(COLUMNS, ms2.reshape(-1, 3).T, strict=True))
    samples = written(tmp_path / f"samples{suffix}", columns, gravity_ms2=str(LOCAL))
    read = {
        "reduce": found.readings,
        "calibrate": read_positions(means).readings,
        "apply": read_raw(means).readings,
        "diagnose --samples": np.array([one.mean(0) for one in read_position_samples(samples).force]),
    }
    for name, values in read.items():
        np.testing.assert_allclose(values, readings, atol=2e-5, err_msg=name)
    assert read_positions(means).gravity == Gravity(LOCAL, "stated") and found.gravity == Gravity(LOCAL, "given")
