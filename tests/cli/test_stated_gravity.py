"""`--gravity`: what the readings in m/s^2 are divided by, what is said without it, and a device at another site."""

import json

import numpy as np
import polars as pl
import pytest

from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.ground.gravity import Gravity


LOCAL, STANDARD = 9.8123, 9.80665
AXES = ("x", "y", "z")


@pytest.fixture
def in_ms2(tmp_path, table1):
    """Table 1 in m/s^2, no gravity stated."""

    def written(suffix):
        columns = {"position": table1.names, "alpha_deg": table1.alpha_deg, "beta_deg": table1.beta_deg}
        columns |= {f"a{axis}_ms2": values for axis, values in zip(AXES, (table1.readings * LOCAL).T, strict=True)}
        path = tmp_path / f"ms2{suffix}"
        frame = pl.DataFrame(columns)
        frame.write_parquet(path) if suffix == ".parquet" else frame.write_csv(path)
        return path

    return written


def scale_factors(folder):
    parameters = json.loads((folder / "result.json").read_text())["methods"]["exact"]["parameters"]
    return np.array([parameters[f"dK_{axis}"]["value"] for axis in AXES])


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_without_a_gravity_it_is_said_loudly_and_with_one_the_scale_factors_are_right(
    tumblecal, tmp_path, table1_fit, in_ms2, suffix
):
    data = in_ms2(suffix)
    silent = tumblecal("calibrate", data, "--no-figures", "--out", tmp_path / "silent")
    told = " ".join(silent.out.split())
    assert (
        silent.code == 0
        and "WARNING: the readings are in m/s^2 and no gravity is stated; 9.80665 m/s^2 is assumed" in told
    )
    # Normal gravity on the equator and at the poles: 9.7803 and 9.8322 m/s^2.
    assert "changes every dK by up to 2.7e-3, " in told and "u. State it: --gravity" in told
    stated = tumblecal("calibrate", data, "--gravity", LOCAL, "--no-figures", "--out", tmp_path / "stated")
    assert stated.code == 0 and "WARNING" not in stated.out
    assert "one g is 9.8123 m/s^2 (stated on the command line)" in " ".join(stated.out.split())
    right = np.array([table1_fit.value(f"dK_{axis}") for axis in AXES])
    np.testing.assert_allclose(scale_factors(tmp_path / "stated"), right, atol=1e-9)
    np.testing.assert_allclose(scale_factors(tmp_path / "silent"), (1 + right) * LOCAL / STANDARD - 1, atol=1e-9)
    for name, value in (("silent", STANDARD), ("stated", LOCAL)):
        for file in ("result.json", "calibration.json"):
            assert json.loads((tmp_path / name / file).read_text())["gravity"]["value_ms2"] == value


def test_a_site_and_a_file_that_says_otherwise(tumblecal, tmp_path, in_ms2):
    """The site's normal gravity (GRS 80: 9.806199 m/s^2 at 45 degrees); the option goes before the file."""
    data = in_ms2(".csv")
    data.write_text("# gravity_ms2: 9.7803\n" + data.read_text())
    outcome = tumblecal("calibrate", data, "--gravity", "lat=45, height=0", "--no-figures", "--out", tmp_path / "out")
    assert outcome.code == 0
    stated = json.loads((tmp_path / "out" / "calibration.json").read_text())["gravity"]
    assert stated["value_ms2"] == pytest.approx(9.806199, abs=2e-6)
    assert stated["source"] == "normal gravity at latitude 45 deg, height 0 m"


def test_diagnose_takes_and_keeps_it(tumblecal, tmp_path, in_ms2):
    outcome = tumblecal("diagnose", in_ms2(".csv"), "--gravity", LOCAL, "--out", tmp_path / "out", "--no-figures")
    assert outcome.code == 0 and "one g is 9.8123 m/s^2 (stated on the command line)" in outcome.out
    kept = {"value_ms2": LOCAL, "source": "stated on the command line"}
    for file in ("diagnosis.json", "calibration.json"):
        assert json.loads((tmp_path / "out" / file).read_text())["gravity"] == kept


@pytest.mark.parametrize("text", ["3.7", "abc", "lat=100", "lat=45,hight=3", "lat=45,height=90000", ""])
def test_what_is_no_gravity(tumblecal, tmp_path, in_ms2, text):
    outcome = tumblecal("calibrate", in_ms2(".csv"), "--gravity", text, "--out", tmp_path / "out")
    assert outcome.code == 2 and len(outcome.lines) == 1 and outcome.lines[0].startswith("tumblecal: --gravity")
    assert not (tmp_path / "out").exists()


BIAS, MATRIX = np.array([0.01, -0.02, 0.03]), np.diag([1.001, 0.999, 1.002])


def calibration(path, **kept):
    write_calibration(path, Calibration(MATRIX, BIAS, np.eye(12) * 1e-12, **kept))
    return path


def log(path, unit, rows, *comments):
    header = ",".join(f"a{axis}_{unit}" for axis in AXES)
    lines = [*(f"# {comment}" for comment in comments), header, *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_device_at_another_site(tumblecal, tmp_path):
    """Calibrated under 9.8333, used under 9.7803: at rest it reads 9.7803 / 9.8333 g of the first, one of the second."""
    there, here = 9.7803, 9.8333
    cal = calibration(tmp_path / "cal.json", gravity=Gravity(here, "given"))
    true = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, -0.8]]) * there / here
    readings = true @ np.linalg.inv(MATRIX).T + BIAS
    for unit, size in (("g", 1.0), ("mg", 1e3)):
        raw = log(tmp_path / "raw.csv", unit, readings * size)
        outcome = tumblecal("apply", cal, raw, "--gravity", there, "--out", tmp_path / "out.csv")
        assert outcome.code == 0 and "one g of the corrected columns is 9.7803 m/s^2" in outcome.out
        text = (tmp_path / "out.csv").read_text()
        assert "# gravity_ms2: 9.7803\n" in text
        corrected = pl.read_csv(tmp_path / "out.csv", comment_prefix="#").to_numpy() / size
        np.testing.assert_allclose(corrected, true * here / there, atol=1e-12)
    # In m/s^2 the place changes nothing.
    raw = log(tmp_path / "raw.csv", "ms2", readings * here)
    assert tumblecal("apply", cal, raw, "--gravity", there, "--out", tmp_path / "out.csv").code == 0
    corrected = pl.read_csv(tmp_path / "out.csv", comment_prefix="#").to_numpy()
    np.testing.assert_allclose(corrected, true * here, atol=1e-12)


@pytest.mark.parametrize(
    "source", ["standard gravity, none stated", "gravimeter (No. 12)", "standard gravity (none stated)"]
)
def test_brackets_are_not_nested(tumblecal, tmp_path, source):
    assert "((" not in str(Gravity(9.81, source)) and "))" not in str(Gravity(9.81, source))
    write_calibration(
        tmp_path / "cal.json",
        Calibration(np.eye(3), np.zeros(3), np.eye(12) * 1e-12, gravity=Gravity(STANDARD, source)),
    )
    outcome = tumblecal("export", tmp_path / "cal.json", "--to", "px4")
    assert outcome.code == 0 and "))" not in outcome.out + "".join(outcome.lines)


@pytest.mark.parametrize("command", ["reduce", "import"])
def test_help_says_when_gravity_counts_and_how_it_is_written(tumblecal, command):
    told = " ".join(tumblecal(command, "--help").out.replace("│", " ").split())
    for words in (
        "such as 9.8123",
        "lat=48.14,height=520",
        "reduce divides readings in m/s^2 by it",
        "Readings in g, mg or counts do not change",
    ):
        assert words in told, told


def test_another_site_needs_a_calibration_that_says_its_own(tumblecal, tmp_path):
    raw = log(tmp_path / "raw.csv", "g", [[0, 0, 1]])
    outcome = tumblecal("apply", calibration(tmp_path / "cal.json"), raw, "--gravity", "9.8")
    assert outcome.code == 2 and "no gravity is stated" in outcome.lines[0]


def test_another_unit_s_log_is_refused_unless_insisted(tumblecal, tmp_path):
    cal = calibration(tmp_path / "cal.json", serial_number="A17")
    raw = log(tmp_path / "raw.csv", "g", [[0, 0, 1]], "serial_number: B4")
    outcome = tumblecal("apply", cal, raw, "--out", tmp_path / "out.csv")
    assert outcome.code == 2 and len(outcome.lines) == 1
    assert "serial number B4, but" in outcome.lines[0] and "is of A17" in outcome.lines[0]
    assert not (tmp_path / "out.csv").exists()
    assert tumblecal("apply", cal, raw, "--out", tmp_path / "out.csv", "--other-unit").code == 0
    same = log(tmp_path / "same.csv", "g", [[0, 0, 1]], "serial_number: A17")
    assert tumblecal("apply", cal, same, "--out", tmp_path / "out2.csv").code == 0


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([[0, 0, 9.81], [9.8, 0, 0], [0, -9.8, 0.1]], "so they look like m/s^2; name them ax_ms2"),
        ([[0, 0, 1], [0, 50, 1], [0, 0, 1]], "1 of 3 rows (the first: line 3) are beyond 2 g, up to 50 g"),
        ([[0, 0, 1], [0, 1, 0.1]], None),
    ],
)
def test_what_is_unlikely_is_said(tumblecal, tmp_path, rows, words):
    raw = log(tmp_path / "raw.csv", "g", rows)
    outcome = tumblecal("apply", calibration(tmp_path / "cal.json"), raw, "--out", tmp_path / "out.csv")
    assert outcome.code == 0
    said = [line for line in outcome.lines if "WARNING" in line]
    assert (len(said) == 1 and words in said[0]) if words else not said


def test_a_row_that_was_copied_is_named(tumblecal, tmp_path, table1_file):
    text = table1_file.read_text()
    row = next(line for line in text.splitlines() if line.startswith("0-1,"))
    table1_file.write_text(text + row.replace("0-1,", "again,") + "\n")
    outcome = tumblecal("calibrate", table1_file, "--no-figures", "--out", tmp_path / "out")
    assert outcome.code == 0 and any("positions again and 0-1; a copied row" in line for line in outcome.lines)


@pytest.mark.parametrize("unit", ["g", "mg"])
@pytest.mark.parametrize("own", [None, 9.79, 9.8])
@pytest.mark.parametrize("local", [None, 9.78, 9.79])
def test_columns_in_g_are_converted_once(tumblecal, tmp_path, unit, own, local):
    """By hand in m/s^2: readings in g of `own` (else the calibration's), forces written in g of `local` (else of `own`)."""
    its, bias, reading = 9.8123, np.array([0.01, -0.02, 0.03]), np.array([0.03, -0.02, 1.02])
    write_calibration(
        tmp_path / "cal.json", Calibration(np.diag([0.95, 1.0, 1.02]), bias, np.eye(12), gravity=Gravity(its, "given"))
    )
    one_g = 1e3 if unit == "mg" else 1.0
    stated = f"# gravity_ms2: {own}\n" if own else ""
    cells = ",".join(repr(float(cell)) for cell in reading * one_g)
    (tmp_path / "log.csv").write_text(f"{stated}{','.join(f'a{axis}_{unit}' for axis in 'xyz')}\n{cells}\n")
    given = ["--gravity", local] if local else []
    assert tumblecal("apply", tmp_path / "cal.json", tmp_path / "log.csv", *given).code == 0
    corrected_ms2 = (reading * (own or its) - bias * its) * [0.95, 1.0, 1.02]
    got = pl.read_csv(tmp_path / "log_corrected.csv", comment_prefix="#").to_numpy()[0] / one_g
    np.testing.assert_allclose(got, corrected_ms2 / (local or own or its), rtol=1e-12)
    comments = (tmp_path / "log_corrected.csv").read_text()
    assert (f"# gravity_ms2: {local or own}" in comments) == bool(local or own)
