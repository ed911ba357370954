"""Readings of any source corrected a piece at a time."""

import numpy as np
import polars as pl
import pytest

from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.data.temperature_curves import Curve, TemperatureCurves, order_of_covariance
from tumblecal.ground.temperature_functions import TemperatureFunctions


RNG = np.random.default_rng(4)
MATRIX, BIAS = np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), np.array([0.02, -0.03, 0.05])
BY_DEGREE = {"axis": "x", "powers": [0, 0, 0], "coefficient": 1e-4, "per_degc": True, "reference_degc": 25.0}
BY_HOUR = {"axis": "z", "powers": [0, 0, 0], "coefficient": 2e-3, "per_hour": True, "reference_s": 1800.0}


def calibration(*terms, **more):
    return Calibration(MATRIX, BIAS, np.zeros((12, 12)), extra={"terms": list(terms)} if terms else {}, **more)


@pytest.mark.parametrize("follows", ["terms", "a curve"])
@pytest.mark.parametrize("suffix", ["csv", "parquet", "txt"])
def test_temperature_and_time_in_pieces_are_the_formula(tumblecal, tmp_path, small_pieces, suffix, follows):
    """Against the formula in numpy, for a table of this program, and text of another layout (a recording)."""
    times, degc, readings = np.arange(40) / 10, RNG.uniform(0, 60, 40), 0.3 * RNG.normal(size=(40, 3))
    unit, size = ("mg", 1e3) if suffix == "txt" else ("g", 1.0)
    names = ["time_s", *(f"a{axis}_{unit}" for axis in "xyz"), "temperature_degc"]
    frame = pl.DataFrame(dict(zip(names, [times, *(size * readings.T), degc], strict=True)))
    path, out = tmp_path / f"log.{suffix}", tmp_path / "out.parquet"
    how = ["--columns", "time=1,ax=2,ay=3,az=4,temperature=5", "--unit", "mg"] if suffix == "txt" else []
    if suffix == "parquet":
        frame.write_parquet(path)
    else:
        frame.write_csv(path, **({"separator": ";", "include_header": False} if suffix == "txt" else {}))
    own, added = (calibration(BY_DEGREE, BY_HOUR) if follows == "terms" else cubic()), np.zeros((40, 3))
    if follows == "terms":
        added[:, 0], added[:, 2] = 1e-4 * (degc - 25), 2e-3 * (times - 1800) / 3600
    else:
        added[:, 1] = 1e-4 * (degc - 25) - 2e-6 * (degc - 25) ** 2 + 3e-8 * (degc - 25) ** 3
    write_calibration(tmp_path / "cal.json", own)
    outcome = tumblecal("apply", tmp_path / "cal.json", path, *how, "--out", out)
    assert outcome.code == 0 and "40 rows corrected" in outcome.out
    got = pl.read_parquet(out)
    expected = (readings - added - BIAS) @ own.matrix.T
    np.testing.assert_allclose(
        got.select(f"a{a}_{unit}" for a in "xyz").cast(pl.Float64).to_numpy() / size, expected, atol=1e-14
    )
    np.testing.assert_allclose(got["temperature_degc"].cast(pl.Float64), degc)


def cubic(*, coefficients=(1e-4, -2e-6, 3e-8), sd=(1e-6, 1e-8, 1e-10)):
    """A calibration whose bias along y is a cubic polynomial of temperature about 25 degC, measured from 0 to 60 degC."""
    curve = Curve("bias_y", TemperatureFunctions(3, 25.0, (0.0, 60.0)), np.array(coefficients))
    covariance = np.diag([*[1e-5**2] * 9, *np.square(sd)])
    curves = TemperatureCurves((curve,), covariance, order_of_covariance([curve]))
    lower = np.tril(MATRIX)
    return Calibration(lower, BIAS, np.zeros((12, 12)), temperature=curves)


def test_rows_outside_the_measured_temperatures_need_an_option(tumblecal, tmp_path, small_pieces):
    write_calibration(tmp_path / "cal.json", cubic())
    rows = [f"{degc},0,0,1" for degc in (20, 61, *[25] * 20, -3, 75, 60, 0)]
    (tmp_path / "log.csv").write_text("temperature_degc,ax_g,ay_g,az_g\n" + "\n".join(rows) + "\n")
    arguments = ["apply", tmp_path / "cal.json", tmp_path / "log.csv", "--out", tmp_path / "out.csv"]
    outcome = tumblecal(*arguments)
    assert outcome.code == 2 and len(outcome.lines) == 1 and not (tmp_path / "out.csv").exists()
    assert (
        "log.csv: temperatures in 3 of 26 rows (the first: line 3) are outside the measured 0 to 60 degC, up to 75 degC, "
        f"where {tmp_path / 'cal.json'} was not measured; remove these rows, or give --extrapolate" in outcome.lines[0]
    )
    outcome = tumblecal(*arguments, "--extrapolate")
    (said,) = [line for line in outcome.lines if "WARNING" in line]
    # sd of the bias: (1e-5)^2 + (1e-6 h)^2 + (1e-8 h^2)^2 + (1e-10 h^3)^2 with h of 50 and 35 degC
    at_75, at_60 = (1e3 * np.sqrt(1e-10 + 1e-12 * h**2 + 1e-16 * h**4 + 1e-20 * h**6) for h in (50, 35))
    assert f"standard uncertainties there are {at_75:.2g} mg for bias_y ({at_60:.2g} at 60 degC)" in said
    got = pl.read_csv(tmp_path / "out.csv", comment_prefix="#")["ay_g"][23]
    bias = BIAS[1] + 1e-4 * 50 - 2e-6 * 50**2 + 3e-8 * 50**3
    lower = np.tril(MATRIX)
    assert got == pytest.approx(lower[1] @ (np.array([0, 0, 1]) - [BIAS[0], bias, BIAS[2]]), abs=1e-14)
    (tmp_path / "log.csv").write_text("temperature_degc,ax_g,ay_g,az_g\n20,0,0,1\nnan,0,0,1\n")
    outcome = tumblecal(*arguments[:3], "--extrapolate")
    assert outcome.code == 2 and "line 3, column temperature_degc: 'nan' is not a finite number" in outcome.lines[0]


def test_unlikely_readings_and_temperatures_beyond_the_calibrated_are_counted(tumblecal, tmp_path, small_pieces):
    """With the lines of the file; in pieces as tested for the checks themselves."""
    write_calibration(
        tmp_path / "cal.json", calibration(BY_DEGREE, provenance={"temperature_range_degc": [20.0, 30.0]})
    )
    rows = [f"{degc},0,0,{1 + 2 * (degc == 12)}" for degc in (*range(20, 31), 30.5, 35, 12, *[25] * 10, 40)]
    (tmp_path / "log.csv").write_text("temperature_degc,ax_g,ay_g,az_g\n" + "\n".join(rows) + "\n")
    outcome = tumblecal("apply", tmp_path / "cal.json", tmp_path / "log.csv")
    beyond, degc = (line for line in outcome.lines if "WARNING" in line)
    assert "1 of 25 rows (the first: line 15) are beyond 2 g, up to 3 g" in beyond
    assert "temperatures in 3 of 25 rows (the first: line 14) are beyond the 20 to 30 degC of the calibration" in degc
