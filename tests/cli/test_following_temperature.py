"""Rigs with `[temperature]` by the command line, against an independent instrument with a cubic bias over five soaks."""

import json

import numpy as np
import polars as pl
import pytest

import independent
from independent import Instrument


pytestmark = pytest.mark.usefixtures("few_effects")


SOAKS, REFERENCE = np.array([-20.0, 0.0, 20.0, 40.0, 60.0]), 20.0
BIAS = np.array([[2e-3, -1.5e-3, 3e-3], [1e-4, -5e-5, 2e-4], [-2e-6, 3e-6, 1e-6], [8e-8, -6e-8, 8e-8]])
DK, GAMMA = np.array([5e-4, -3e-4, 8e-4]), np.array([4e-4, -3e-4, 2e-4])
NOISE = 1e-4
RIG = """
schema = "tumblecal.rig/1"
[plan]
alpha_deg = { start = 0, step = 45, count = 8 }
beta_deg = [0, 45, 90]
temperature_degc = [-20, 0, 20, 40, 60]
[temperature]
reference_degc = 20
[temperature.bias]
order = 3
"""


def bias(degc: np.ndarray) -> np.ndarray:
    return np.stack([(degc - REFERENCE) ** k for k in range(4)], axis=1) @ BIAS


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("soaks"), np.random.default_rng(5)
    alpha, beta = np.tile(np.arange(8) * 45.0, 15), np.tile(np.repeat([0.0, 45.0, 90.0], 8), 5)
    degc, setting = np.repeat(SOAKS, 24), np.tile(np.repeat([0, 1, 2], 8), 5)
    true = Instrument(DK, np.zeros(3), np.array([2e-3, -1.5e-3, 1e-3]), GAMMA, np.array([6e-4, -4e-4, 3e-4])[setting])
    read = independent.readings(np.radians(alpha), np.radians(beta), true) + bias(degc)
    read += NOISE * rng.standard_normal(read.shape)
    table = np.column_stack([np.arange(120), alpha, beta, read, degc])
    header = "position,alpha_deg,beta_deg,ax_g,ay_g,az_g,temperature_degc"
    np.savetxt(folder / "soaks.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    (folder / "rig.toml").write_text(RIG)
    return folder


@pytest.mark.long
def test_a_cubic_bias_is_corrected_as_well_as_by_plain_least_squares(tumblecal, measured, tmp_path):
    """The nominal model left 4.8 mg, the linear terms of a diagnosis more than 1 mg."""
    out = tmp_path / "out"
    options = ("--rig", measured / "rig.toml", "--noise-sd", "0.1mg", "--no-figures", "--out", out)
    ran = tumblecal("calibrate", measured / "soaks.csv", *options)
    assert ran.code == 0 and "bias_x/degC^3" in ran.out and "bias by order 3" in ran.out.replace("\n", " ")
    record = json.loads((out / "calibration.json").read_text())
    temperature = record["temperature"]
    assert temperature["range_degc"] == [-20.0, 60.0] and record["temperature_degc"] == REFERENCE
    sd = np.sqrt(np.diag(temperature["covariance"]))[9:].reshape(3, 3)
    fitted = np.array([curve["coefficients"] for curve in temperature["curves"]])
    assert [curve["parameter"] for curve in temperature["curves"]] == ["bias_x", "bias_y", "bias_z"]
    assert np.all(np.abs(fitted - BIAS[1:].T) < 4 * sd)
    result = json.loads((out / "result.json").read_text())
    assert result["temperature"]["coefficients"]["bias_y/degC^2"]["value"] == pytest.approx(fitted[1, 1])
    assert "bias_T_x3" in result["methods"]["exact"]["parameters"]

    rng = np.random.default_rng(6)
    force, degc = rng.standard_normal((2000, 3)), rng.uniform(-20, 60, 2000)
    force /= np.linalg.norm(force, axis=1)[:, None]
    triad = np.array([[1, 0, 0], [GAMMA[0], 1, 0], [GAMMA[1], GAMMA[2], 1]])
    read = (1 + DK) * (force @ triad.T) + bias(degc) + NOISE * rng.standard_normal(force.shape)
    raw = tmp_path / "raw.csv"
    np.savetxt(raw, np.column_stack([read, degc]), delimiter=",", header="ax_g,ay_g,az_g,temperature_degc", comments="")
    assert tumblecal("apply", out / "calibration.json", raw, "--out", tmp_path / "corrected.csv").code == 0
    corrected = pl.read_csv(tmp_path / "corrected.csv", comment_prefix="#").select("ax_g", "ay_g", "az_g").to_numpy()
    assert np.sqrt(np.mean((corrected - force) ** 2)) < 1.06 * NOISE
