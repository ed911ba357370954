"""Effects that a model is given with, such as a rig's, are in calibration.json: as terms, else named as what it cannot hold."""

import json
import re

import numpy as np
import polars as pl
import pytest

import tumblecal as package
from tumblecal.effects.catalogue import catalogue
from tumblecal.ground.errors import InputError
from tumblecal.report.result_file import calibration_of


NOISE_MG = 0.1
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


@pytest.mark.parametrize("command", ["calibrate", "diagnose"])
def test_what_a_rig_has_fitted_is_applied(tumblecal, tmp_path, measured, command):
    """It was fitted, left out of the file, and said nowhere: |f| - 1 g was thirteen times the noise."""
    out = tmp_path / "out"
    ran = tumblecal(command, measured, "--rig", rig_file(tmp_path, *SENSOR), "--no-figures", "--out", out)
    assert ran.code == 0
    assert f"erms of calibration.json, beside matrix and bias: {', '.join(SENSOR)}" in " ".join(ran.out.split())
    content = json.loads((out / "calibration.json").read_text())
    assert [term["effect"] for term in content["terms"]] == list(SENSOR)
    assert all(term["determined"] for term in content["terms"])
    for term, truth in zip(content["terms"], (3.0e-3, 0.2e-3), strict=True):
        assert term["coefficient"] == pytest.approx(truth, abs=0.3e-3)
    assert not content["provenance"].get("not_applied")
    rms, said = size_of_force_mg(tumblecal, out / "calibration.json", measured)
    assert rms < 1.3 * NOISE_MG and "not applied" not in said
    exported = tumblecal("export", out / "calibration.json", "--to", "px4", "--out", tmp_path / "px4.params")
    assert exported.code == 0 and "nonlinear terms" in " ".join([exported.out, *exported.lines])


@pytest.mark.parametrize("command", ["calibrate", "diagnose"])
def test_what_no_file_holds_is_said_everywhere(tumblecal, tmp_path, measured, command):
    out, rig = tmp_path / "out", rig_file(tmp_path, *SENSOR, *LEFT)
    ran = tumblecal(command, measured, "--rig", rig, "--out", out, "--no-figures")
    assert "itted, but not in calibration.json, which can hold no term for them: " in " ".join(ran.out.split())
    content = json.loads((out / "calibration.json").read_text())
    assert [term["effect"] for term in content["terms"]] == list(SENSOR)
    assert sorted(content["provenance"]["not_applied"]) == sorted(LEFT)
    # Beside a drift of the rig's own the bias is that of its zero, the first position.
    assert command == "calibrate" or content["provenance"]["reference"] == {"temperature_degc": 25.0}
    _, said = size_of_force_mg(tumblecal, out / "calibration.json", measured)
    assert all(effect in said for effect in LEFT)
    # No calibration of a sensor holds the head's errors: nobody is warned of that.
    quiet = tumblecal(command, measured, "--rig", rig, "--out", out, "--no-figures", "--quiet")
    assert "no term for them: bias_drift.x;" in " ".join(quiet.lines)
    twin = tmp_path / "twin.csv"
    twin.write_text(measured.read_text() + "# another\n")
    several = tumblecal(command, measured, twin, "--rig", rig, "--out", tmp_path / "several")
    assert several.out.count("no term for them: bias_drift.x;") == 2


def test_what_the_diagnosis_finds_stands_beside_what_the_rig_has(tumblecal, tmp_path, measured):
    out = tmp_path / "out"
    rig = rig_file(tmp_path, "scale_temperature.y")
    assert tumblecal("diagnose", measured, "--rig", rig, "--out", out, "--no-figures").code == 0
    content = json.loads((out / "calibration.json").read_text())
    effects = [term["effect"] for term in content["terms"]]
    assert effects[0] == "scale_temperature.y" and "second_order.z" in effects
    places = [(term["axis"], *term["powers"], term.get("kind"), term.get("per_degc")) for term in content["terms"]]
    assert len(set(places)) == len(places)
    assert size_of_force_mg(tumblecal, out / "calibration.json", measured)[0] < 1.3 * NOISE_MG


def test_the_page_applies_the_terms(tumblecal, tmp_path, measured):
    out = tmp_path / "out"
    assert tumblecal("calibrate", measured, "--rig", rig_file(tmp_path, *SENSOR), "--out", out).code == 0
    page = " ".join(re.sub(r"<[^>]+>", " ", (out / "calibration.html").read_text()).split())
    assert "calibration.corrected(readings, temperature_degc=temperature_degc)" in page
    assert "(readings - bias) @ matrix.T" not in page and "f = matrix (A - bias - terms)" in page


def test_a_users_effect_has_the_form_that_it_states(tumblecal, tmp_path, measured):
    mine, rig, out = tmp_path / "mine.py", rig_file(tmp_path, "my_square", "scale_temperature.y"), tmp_path / "out"
    rig.write_text(rig.read_text().replace('"second_order.z" =', "my_square ="))
    options = [measured, "--rig", rig, "--effects", mine, "--no-figures", "--out", out]
    mine.write_text(MINE.replace("FORM", '{"axis": "z", "powers": [0, 0, 2]}'))
    assert tumblecal("calibrate", *options).code == 0
    content = json.loads((out / "calibration.json").read_text())
    assert {term["effect"] for term in content["terms"]} == {"my_square", "scale_temperature.y"}
    assert size_of_force_mg(tumblecal, out / "calibration.json", measured)[0] < 1.3 * NOISE_MG
    # In a notebook, with the catalogue that the rig was read with and without it: then it is named as left out.
    entries = catalogue(mine)
    given = package.read_rig(rig, entries)
    data = package.read_positions(measured)
    calibrated = package.calibrate(data, chain=given.chain(given.where), noise_sd=1e-4, entries=entries)
    calibrated.save(tmp_path / "saved.json")
    assert len(package.load(tmp_path / "saved.json").extra["terms"]) == 2
    assert calibration_of(calibrated.exact).provenance["not_applied"] == ["my_square"]
    mine.write_text(MINE.replace("FORM", ""))
    ran = tumblecal("calibrate", *options)
    assert ran.code == 0 and "no term for them: my_square; apply" in " ".join(ran.out.split())
    twice = '{"axis": "z", "powers": [0, 0, 2]}, {"axis": "z", "powers": [0, 0, 3]}'
    mine.write_text(MINE.replace("FORM", twice))
    with pytest.raises(
        InputError, match=r"mine.py:line 5: effect 'my_square': 2 forms for 1 coefficient; give one for"
    ):
        catalogue(mine)


def test_budget_certificate_comparison_and_history_take_such_files(tumblecal, tmp_path, configs, measured):
    rig, out, text = rig_file(tmp_path, *SENSOR), tmp_path / "out", measured.read_text()
    data = tmp_path / "data.csv"
    data.write_text(f"# serial_number: S1\n{text}")
    stated = ["--rig", rig, "--gravity", "9.81"]
    files = [tmp_path / "history", "--quiet"]
    assert tumblecal("calibrate", data, *stated, "--no-figures", "--out", out, "--history", *files).code == 0
    considered = tmp_path / "considered.toml"
    whole = (configs / "considered_lab.toml").read_text()
    considered.write_text(re.sub(r"\[considered\.nonlinearity\][^\[]*", "", whole))
    assert tumblecal("budget", data, considered, *stated, "--out", out).code == 0
    assert tumblecal("certificate", out, "--admin", configs / "certificate_lab.toml", "--out", tmp_path / "c").code == 0
    page = " ".join(re.sub(r"<[^>]+>", " ", (tmp_path / "c" / "certificate.html").read_text()).split())
    assert "The values hold at 25 degC: dK_y changes by" in page and "calibration.json has nonlinear" in page
    compared = tumblecal("compare", out / "calibration.json", out / "calibration.json")
    assert compared.code == 0 and "nonlinear and thermal terms are not compared" in " ".join(
        [compared.out, *compared.lines]
    )
    assert "S1" in tumblecal("history", tmp_path / "history", "S1").out
