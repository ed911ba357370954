"""Effects that a model is given with, such as a rig's, are in calibration.json: as terms, else named as what it cannot hold."""

import json

import numpy as np
import polars as pl
import pytest

import tumblecal as package
from independent import Instrument
from independent import readings as linear_readings
from tumblecal.data import PositionSet
from tumblecal.data.calibration_terms import Term
from tumblecal.estimation import exact, problem_of, where_of
from tumblecal.lab.terms import undetermined_order


NOISE_MG = 0.1
FIVE_SOAKS = [-20.0, 0.0, 20.0, 40.0, 60.0]
# Of the sensor: a square, and a scale factor that follows the temperature. Of neither: the head's index, the time.
RIG = """schema = "tumblecal.rig/1"
[plan]
alpha_deg = { start = 0, step = 30, count = 12 }
beta_deg = [0, 45, 90]
interval_s = 300
temperature_degc = { start = 15.0, end = 35.0 }
[chain]
effects = [EFFECTS]
[truth]
"second_order.z" = { value = 3.0, unit = "mg/g^2" }
"scale_temperature.y" = { value = 0.2, unit = "(mg/g)/degC" }
[noise]
sd = "0.1 mg"
"""
SENSOR, LEFT = ("second_order.z", "scale_temperature.y"), ("bias_drift.x", "index_eccentricity")
MINE = """from tumblecal.effects import output_effect

EFFECTS = [
    output_effect(
        "my_square", "z", lambda u, where: u[2] ** 2, unit="mg/g^2", typical=0.2, physics="K u^2", cause="Bends.",
        forms=[FORM],
    )
]
"""


def rig_file(folder, *effects):
    path = folder / f"rig{len(effects)}.toml"
    path.write_text(RIG.replace("EFFECTS", ", ".join(f'"{effect}"' for effect in effects)))
    return path


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Readings of that sensor; the file."""
    folder = tmp_path_factory.mktemp("measured")
    data = package.simulate(package.read_rig(rig_file(folder, *SENSOR)), 3)
    from tumblecal.data import write_positions

    write_positions(folder / "data.csv", data)
    return folder / "data.csv"


def size_of_force_mg(tumblecal, calibration, data):
    """The rms of |f| - 1 g after `apply`, and what it printed."""
    out = calibration.with_name("corrected.csv")
    applied = tumblecal("apply", calibration, data, "--out", out)
    assert applied.code == 0
    force = pl.read_csv(out, comment_prefix="#").select("ax_g", "ay_g", "az_g").to_numpy()
    return 1e3 * float(np.sqrt(np.mean((np.linalg.norm(force, axis=1) - 1) ** 2))), applied.out


@pytest.mark.long
@pytest.mark.usefixtures("few_effects")
@pytest.mark.parametrize("command", ["calibrate", pytest.param("diagnose", marks=pytest.mark.long)])
def test_what_a_rig_has_fitted_is_applied(tumblecal, tmp_path, measured, command):
    """It was fitted, left out of the file, and said nowhere: |f| - 1 g was thirteen times the noise."""
    out = tmp_path / "out"
    ran = tumblecal(command, measured, "--rig", rig_file(tmp_path, *SENSOR), "--no-figures", "--out", out)
    assert ran.code == 0
    assert f"erms of calibration.json, in addition to matrix and bias: {', '.join(SENSOR)}" in " ".join(ran.out.split())
    content = json.loads((out / "calibration.json").read_text())
    assert [term["effect"] for term in content["terms"]] == list(SENSOR)
    assert all(term["determined"] for term in content["terms"])
    for term, truth in zip(content["terms"], (3.0e-3, 0.2e-3), strict=True):
        assert term["coefficient"] == pytest.approx(truth, abs=0.3e-3)
    assert not content["provenance"].get("not_applied")
    rms, said = size_of_force_mg(tumblecal, out / "calibration.json", measured)
    assert rms < 1.3 * NOISE_MG and "not in this calibration" not in said
    exported = tumblecal("export", out / "calibration.json", "--to", "px4", "--out", tmp_path / "px4.params")
    assert exported.code == 0 and "nonlinear terms" in " ".join([exported.out, *exported.lines])


@pytest.mark.usefixtures("few_effects")
@pytest.mark.parametrize("command", ["calibrate", pytest.param("diagnose", marks=pytest.mark.long)])
def test_what_no_file_holds_is_said_everywhere(tumblecal, tmp_path, measured, command):
    out, rig = tmp_path / "out", rig_file(tmp_path, *SENSOR, *LEFT)
    ran = tumblecal(command, measured, "--rig", rig, "--out", out, "--no-figures")
    listed = " ".join(ran.out.split()).partition("Not in the calibration file ")[2]
    assert all(f"{id} (up to" in listed for id in LEFT)
    content = json.loads((out / "calibration.json").read_text())
    assert [term["effect"] for term in content["terms"]] == list(SENSOR)
    assert sorted(content["provenance"]["not_applied"]) == sorted(LEFT)
    # Beside a drift of the rig's own the bias is that of its zero, the first position.
    assert command == "calibrate" or content["provenance"]["reference"] == {"temperature_degc": 25.0}
    _, said = size_of_force_mg(tumblecal, out / "calibration.json", measured)
    assert all(effect in said for effect in LEFT)
    if command == "diagnose":  # its warnings: from a record, below
        return
    # No calibration of a sensor holds the head's errors: nobody is warned of that.
    quiet = tumblecal(command, measured, "--rig", rig, "--out", out, "--no-figures", "--quiet")
    words = " ".join(quiet.lines)
    assert "not in this calibration: bias_drift.x (up to" in words and "index_eccentricity" not in words
    twin = tmp_path / "twin.csv"
    twin.write_text(measured.read_text() + "# another\n")
    several = tumblecal(command, measured, twin, "--rig", rig, "--out", tmp_path / "several")
    assert several.out.count("not in this calibration: bias_drift.x (up to") == 2


def test_three_temperatures_leave_the_third_order_open():
    """A cubic about the middle of three soaks reads as a slope at them: 1.7 mg remained and nothing was stated."""
    soaks = np.array([-20.0, 20.0, 60.0])
    cubic = lambda degc: 8e-8 * (degc - 20) ** 3  # noqa: E731
    slope = float(np.polyfit(soaks, cubic(soaks), 1)[0])
    term = Term("x", slope, degc_power=1, reference_degc=20.0, effect="bias_temperature.x")
    around = np.concatenate([soaks, soaks + 0.3, soaks - 0.4])
    loss = undetermined_order([term], around)
    between = np.linspace(-20, 60, 1001)
    hidden = cubic(between) - slope * (between - 20)
    assert loss.effect == "temperature^3" and "3 temperatures measured (-20, 20, 60 degC)" in loss.reason
    assert loss.largest_mg == pytest.approx(1e3 * np.max(np.abs(hidden)), rel=0.02)
    assert loss.rms_mg == pytest.approx(1e3 * np.sqrt(np.mean(hidden**2)), rel=0.02)
    assert undetermined_order([term], np.array([10.0, 10.2, 40.0])).effect == "temperature^2"
    assert undetermined_order([term], np.array(FIVE_SOAKS)) is None
    assert undetermined_order([term], np.linspace(15, 35, 36)) is None
    assert undetermined_order([Term("x", 1e-3, (2, 0, 0))], soaks) is None


@pytest.mark.long
def test_a_form_that_is_another_function_than_its_term_is_refused(tumblecal, tmp_path, measured):
    mine, rig = tmp_path / "mine.py", rig_file(tmp_path, "my_square")
    rig.write_text(rig.read_text().replace('"second_order.z" =', "my_square ="))
    mine.write_text(MINE.replace("FORM", '{"axis": "z", "powers": [0, 0, 3]}'))
    ran = tumblecal("calibrate", measured, "--rig", rig, "--effects", mine, "--no-figures", "--out", tmp_path / "out")
    assert ran.code == 2 and "effect my_square: forms.0: differs from the function of the effect" in ran.lines[-1]


# Amplitudes in mg, time constant as a share of the duration. With these seeds the fit ran away, ended at 0.04 of the duration,
# or ended just before the minimum.
@pytest.mark.parametrize(("amplitudes", "share", "seed"), [((1, 1, 0.5), 1.0, 0), ((1, -1, 1), 0.15, 8)])
def test_a_warm_up_converges_wherever_its_time_constant_is(tmp_path, amplitudes, share, seed):
    """It started from 0.07 of the duration alone; from there a constant near the duration ran away to infinity."""
    alpha, beta = (angles.ravel() for angles in np.meshgrid(np.arange(0, 360, 30.0), [0.0, 45.0, 90.0]))
    since = 300.0 * np.arange(36)
    duration = since[-1]
    true = Instrument(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(36))
    readings = linear_readings(np.radians(alpha), np.radians(beta), true)
    noise = np.random.default_rng(seed).normal(0, 1e-4, readings.shape)
    readings = readings + 1e-3 * np.outer(np.exp(-since / (share * duration)), amplitudes) + noise
    data = PositionSet(tuple(f"p{k}" for k in range(36)), alpha, beta, readings, time_s=since)
    chain = package.read_rig(rig_file(tmp_path, "warm_up")).chain(where_of(data))
    fit = exact.fit(problem_of(data, chain.started(), noise_sd=1e-4))
    assert fit.code.good
    # The estimate of its rate is nearly normal, that of the constant is not.
    tau, sd = fit.value("warm_up_tau"), fit.sd[fit.names.index("warm_up_tau")]
    assert abs(1 / tau - 1 / (share * duration)) < 4 * sd / tau**2
    # The smallest sum of squares is below that of the true parameters.
    assert fit.chi2 < np.sum((noise / 1e-4) ** 2)
