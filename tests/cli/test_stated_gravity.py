"""`--gravity`: what the readings in m/s^2 are divided by, what is said without it, and a device at another site."""

import json

import numpy as np
import polars as pl
import pytest

from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.ground.gravity import Gravity


pytestmark = pytest.mark.usefixtures("few_effects")


LOCAL, STANDARD = 9.8123, 9.80665
AXES = ("x", "y", "z")


@pytest.fixture
def in_ms2(tmp_path, table1):
    """Table 1 in m/s^2, no gravity stated."""
    columns = {"position": table1.names, "alpha_deg": table1.alpha_deg, "beta_deg": table1.beta_deg}
    columns |= {f"a{axis}_ms2": values for axis, values in zip(AXES, (table1.readings * LOCAL).T, strict=True)}
    pl.DataFrame(columns).write_csv(tmp_path / "ms2.csv")
    return tmp_path / "ms2.csv"


def scale_factors(folder):
    parameters = json.loads((folder / "result.json").read_text())["methods"]["exact"]["parameters"]
    return np.array([parameters[f"dK_{axis}"]["value"] for axis in AXES])


def test_without_a_gravity_it_is_said_loudly_and_with_one_the_scale_factors_are_right(
    tumblecal, tmp_path, table1_fit, in_ms2
):
    silent = tumblecal("calibrate", in_ms2, "--no-figures", "--out", tmp_path / "silent")
    told = " ".join(silent.out.split())
    assert "WARNING: the readings are in m/s^2 and no gravity is stated; 9.80665 m/s^2 is assumed" in told
    # Normal gravity on the equator and at the poles: 9.7803 and 9.8322 m/s^2.
    assert "changes every dK by up to 2.7e-3, " in told and "u. State it: --gravity" in told
    stated = tumblecal("calibrate", in_ms2, "--gravity", LOCAL, "--no-figures", "--out", tmp_path / "stated")
    assert silent.code == stated.code == 0 and "WARNING" not in stated.out
    right = np.array([table1_fit.value(f"dK_{axis}") for axis in AXES])
    np.testing.assert_allclose(scale_factors(tmp_path / "stated"), right, atol=1e-9)
    np.testing.assert_allclose(scale_factors(tmp_path / "silent"), (1 + right) * LOCAL / STANDARD - 1, atol=1e-9)
    for name, value in (("silent", STANDARD), ("stated", LOCAL)):
        for file in ("result.json", "calibration.json"):
            assert json.loads((tmp_path / name / file).read_text())["gravity"]["value_ms2"] == value


def test_a_site_and_a_file_that_says_otherwise(tumblecal, tmp_path, in_ms2):
    """The site's normal gravity (GRS 80: 9.806199 m/s^2 at 45 degrees); the option goes before the file."""
    in_ms2.write_text("# gravity_ms2: 9.7803\n" + in_ms2.read_text())
    outcome = tumblecal("diagnose", in_ms2, "--gravity", "lat=45, height=0", "--no-figures", "--out", tmp_path / "out")
    assert outcome.code == 0
    for file in ("diagnosis.json", "calibration.json"):
        stated = json.loads((tmp_path / "out" / file).read_text())["gravity"]
        assert stated["value_ms2"] == pytest.approx(9.806199, abs=2e-6)
        assert stated["source"] == "normal gravity at latitude 45 deg, height 0 m"
    for text in ("3.7", "lat=45,hight=3", "lat=45,height=90000", ""):
        outcome = tumblecal("calibrate", in_ms2, "--gravity", text, "--out", tmp_path / "none")
        assert outcome.code == 2 and len(outcome.lines) == 1 and outcome.lines[0].startswith("tumblecal: --gravity")


BIAS, MATRIX = np.array([0.01, -0.02, 0.03]), np.diag([1.001, 0.999, 1.002])


def calibration(path, **kept):
    write_calibration(path, Calibration(MATRIX, BIAS, np.eye(12) * 1e-12, **kept))
    return path


def log(path, unit, rows, *comments):
    header = ",".join(f"a{axis}_{unit}" for axis in AXES)
    lines = [*(f"# {comment}" for comment in comments), header, *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_another_unit_s_log_is_refused_unless_insisted(tumblecal, tmp_path):
    cal = calibration(tmp_path / "cal.json", serial_number="A17")
    raw = log(tmp_path / "raw.csv", "g", [[0, 0, 1]], "serial_number: B4")
    assert tumblecal("apply", cal, raw, "--out", tmp_path / "out.csv").code == 2
    assert tumblecal("apply", cal, raw, "--out", tmp_path / "out.csv", "--other-unit").code == 0
    same = log(tmp_path / "same.csv", "g", [[0, 0, 1]], "serial_number: A17")
    assert tumblecal("apply", cal, same, "--out", tmp_path / "out2.csv").code == 0


@pytest.mark.long
def test_a_row_that_was_copied_is_named(tumblecal, tmp_path, table1_file):
    text = table1_file.read_text()
    row = next(line for line in text.splitlines() if line.startswith("0-1,"))
    table1_file.write_text(text + row.replace("0-1,", "again,") + "\n")
    outcome = tumblecal("calibrate", table1_file, "--no-figures", "--out", tmp_path / "out")
    assert outcome.code == 0 and any("positions again and 0-1; a copied row" in line for line in outcome.lines)


@pytest.mark.parametrize("unit", ["g", "mg", "ms2"])
@pytest.mark.parametrize(("own", "local"), [(None, None), (None, 9.78), (9.79, None), (9.79, 9.78), (9.8, 9.79)])
def test_columns_are_converted_once(tumblecal, tmp_path, unit, own, local):
    """By hand in m/s^2: readings in g of `own` (else the calibration's), forces written in g of `local` (else of `own`)."""
    its, bias, reading = 9.8123, np.array([0.01, -0.02, 0.03]), np.array([0.03, -0.02, 1.02])
    gains = np.array([0.95, 1.0, 1.02])
    write_calibration(
        tmp_path / "cal.json", Calibration(np.diag(gains), bias, np.eye(12), gravity=Gravity(its, "given"))
    )
    size = {"g": 1.0, "mg": 1e3, "ms2": own or its}[unit]
    rows = [(reading * size).tolist()]
    raw = log(tmp_path / "log.csv", unit, rows, *([f"gravity_ms2: {own}"] if own else []))
    given = ["--gravity", local] if local else []
    assert tumblecal("apply", tmp_path / "cal.json", raw, *given).code == 0
    corrected_ms2 = (reading * (own or its) - bias * its) * gains
    got = pl.read_csv(tmp_path / "log_corrected.csv", comment_prefix="#").to_numpy()[0]
    # In m/s^2 the place changes nothing.
    expected = corrected_ms2 if unit == "ms2" else corrected_ms2 / (local or own or its) * size
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-15)
    comments = (tmp_path / "log_corrected.csv").read_text()
    stated = own if unit == "ms2" else local or own
    assert (f"# gravity_ms2: {stated}" in comments) == bool(stated)
