"""One file, one gravity: every command reads units and `# gravity_ms2` alike, from CSV and Parquet."""

import json

import numpy as np
import polars as pl
import pytest
from capture_folder import PLAN, write_capture

from tumblecal.capture.reduction.position_samples import read_position_samples
from tumblecal.capture.reduction.reduce import reduce
from tumblecal.data import read_positions
from tumblecal.data.calibration import Calibration, read_calibration, write_calibration
from tumblecal.data.raw import read_raw
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import Gravity


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
    reduced = reduce(capture.folder).data
    ms2 = capture.samples * STANDARD
    means = positions(tmp_path / f"means{suffix}", ms2.mean(1), gravity_ms2=str(LOCAL))
    columns = {"position": np.repeat(np.array(reduced.names), ms2.shape[1]), "time_s": capture.times_s.ravel()}
    columns |= dict(zip(COLUMNS, ms2.reshape(-1, 3).T, strict=True))
    samples = written(tmp_path / f"samples{suffix}", columns, gravity_ms2=str(LOCAL))
    read = {
        "reduce": reduced.readings,
        "calibrate": read_positions(means).readings,
        "apply": read_raw(means).readings,
        "diagnose --samples": np.array([one.mean(0) for one in read_position_samples(samples).force.values()]),
    }
    for name, values in read.items():
        np.testing.assert_allclose(values, readings, atol=2e-5, err_msg=name)
    assert read_positions(means).gravity == Gravity(LOCAL, "stated") and reduced.gravity == Gravity(LOCAL, "given")


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_calibration_says_its_gravity_and_apply_uses_it(tumblecal, tmp_path, table1, suffix):
    """A log from another site is corrected by the g of the calibration: bias in m/s^2 is the device's, not the site's."""
    bias, matrix = np.array([0.01, -0.02, 0.03]), np.diag([1.001, 0.999, 1.002])
    write_calibration(
        tmp_path / "cal.json", Calibration(matrix, bias, np.eye(12) * 1e-12, gravity=Gravity(LOCAL, "given"))
    )
    assert json.loads((tmp_path / "cal.json").read_text())["gravity"] == {"value_ms2": LOCAL, "source": "given"}
    assert read_calibration(tmp_path / "cal.json").gravity == Gravity(LOCAL, "given")
    raw = np.array([[0.1, 0.2, 9.8], [9.7, -0.3, 0.1]])
    for stated in ({}, {"gravity_ms2": "9.7803", "gravity_source": "the equator"}):
        log = written(tmp_path / f"log{suffix}", dict(zip(COLUMNS, raw.T, strict=True)), **stated)
        outcome = tumblecal("apply", tmp_path / "cal.json", log, "--out", tmp_path / f"out{suffix}")
        assert outcome.code == 0 and f"one g is {LOCAL:.6g} m/s^2 (given), as in the calibration" in outcome.out
        out = tmp_path / f"out{suffix}"
        frame = pl.read_parquet(out) if suffix == ".parquet" else pl.read_csv(out, comment_prefix="#")
        np.testing.assert_allclose(
            frame.select(COLUMNS).to_numpy(), LOCAL * (raw / LOCAL - bias) @ matrix.T, rtol=1e-12
        )


def test_calibrate_states_the_gravity(tumblecal, tmp_path, table1):
    rows = {"position": table1.names, "alpha_deg": table1.alpha_deg, "beta_deg": table1.beta_deg}
    readings = dict(zip(COLUMNS, (table1.readings * LOCAL).T, strict=True))
    told = {}
    for name, comments in {"stated": {"gravity_ms2": str(LOCAL), "gravity_source": "measured"}, "not": {}}.items():
        data = written(tmp_path / f"{name}.csv", rows | readings, **comments)
        assert tumblecal("calibrate", data, "--no-figures", "--out", tmp_path / name).code == 0
        told[name] = json.loads((tmp_path / name / "calibration.json").read_text())["gravity"]
    assert told["stated"] == {"value_ms2": LOCAL, "source": "measured"}
    assert told["not"] == {"value_ms2": STANDARD, "source": "standard gravity, none stated"}


def test_a_gravity_of_another_planet(tmp_path):
    for path in (tmp_path / "a.csv", tmp_path / "a.parquet"):
        positions(path, np.array([[0.0, 0.0, 9.8]]), gravity_ms2="3.71")
        for read in (read_positions, read_raw, read_position_samples):
            with pytest.raises(InputError, match=r"comment gravity_ms2: '3\.71' is not a gravity"):
                read(path)
