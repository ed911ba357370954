"""Certificates: what ISO/IEC 17025 asks stands on the page, the DCC is valid and holds the same numbers, the rule decides."""

import json
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from dcc_schema import schema_of_dcc

from tumblecal import read_rig, simulate
from tumblecal.certificate.results import VERDICTS, Result, results_of
from tumblecal.data.calibration import read_calibration, write_calibration
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.diagnosis import Diagnoser
from tumblecal.estimation import exact, problem_of
from tumblecal.lab.record import calibration_of
from tumblecal.planning import NextPlan
from tumblecal.show.diagnosis import write_diagnosis


UNITS = np.array([9.8123 if name.startswith("bias") else 1.0 for name in SENSOR])  # as the DCC states them
SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}


# What the certificate says of each kind of result.
CASES = {
    "adequate": "The data are consistent with the nominal model.",
    "identified": "In addition to the nominal model the data show axis_perpendicularity; the fitted model includes it.",
    "ambiguous": ". The values are the probability-weighted mean over these models, and the uncertainty includes their spread.",
    "hand-held": "The nominal model was fitted; no diagnosis was made.",
    "several mounts": "The nominal model was fitted; no diagnosis was made.",
}
HIDDEN = {"adequate": {}, "identified": {"axis_perpendicularity": (5e-4,)}}


@pytest.fixture(scope="module")
def folder_of(tmp_path_factory, configs):
    """Results as the commands write them, of simulated instruments of the rigs that come with the program."""
    diagnose, root = Diagnoser(nested=False), tmp_path_factory.mktemp("results")

    @cache
    def made(case: str) -> Path:
        rigs = {"hand-held": "hand_held.toml", "several mounts": "remount.toml"}
        rig = read_rig(configs / rigs.get(case, "hidden_effect.toml"))
        if case in HIDDEN:
            plain = {name: values for name, values in rig.truth.items() if name not in rig.effects}
            rig = replace(rig, effects=tuple(HIDDEN[case]), truth=plain | HIDDEN[case])
        folder, data = root / case, simulate(rig, seed=4)
        own = {"serial_number": "A-17", "gravity_ms2": "9.8123"} | (
            {"attitudes": "unknown"} if case == "hand-held" else {}
        )
        data = replace(data, comments=data.comments | own)
        folder.mkdir()
        if case in rigs:
            fit = exact.fit(problem_of(data, noise_sd=rig.noise_sd_g))
            write_calibration(folder / "calibration.json", calibration_of(fit))
        else:
            diagnosis = diagnose(data, noise_sd=rig.noise_sd_g)
            assert diagnosis.verdict == case
            write_diagnosis(folder, diagnosis, NextPlan(), figures=False)
        return folder

    return made


def test_the_page_has_what_17025_asks_and_prints_on_a4(tumblecal, tmp_path, calibrated, admin, configs):
    outcome = tumblecal("certificate", calibrated, "--admin", admin, "--limits", configs / "certificate_limits.toml")
    assert outcome.code == 0, outcome.lines
    assert "type A" in outcome.out and "conformity: conditional pass; written" in outcome.out
    page = (calibrated / "certificate.html").read_text()
    for words in (
        "Calibration certificate",
        "ACC-2026-0117",
        "Inertial Metrology Laboratory",
        "accreditation 0815",
        "Drones and &lt;Sons&gt; &amp; &#34;Co&#34; Ltd",
        "serial number A-17",
        "as received, no adjustment",
        "received 2026-11-10; calibrated 2026-11-20 to 2026-11-21",
        "least squares over the chain",
        "room temperature",
        "9.8123 m/s^2",
        "certificate G-12",
        "coverage factor k",
        "Statement of conformity",
        "guard band",
        "data sheet M-3",
        "relate only to the item",
        "A. Muster, head of laboratory",
        "End of certificate ACC-2026-0117",
        "type A",
    ):
        assert words in page, words
    chromium = next(
        (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
    )
    if chromium is None:
        pytest.skip("no Chromium to print with")
    pdf = tmp_path / "certificate.pdf"
    asked = ["--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer", f"--print-to-pdf={pdf}"]
    subprocess.run(
        [chromium, *asked, (calibrated / "certificate.html").as_uri()], check=True, capture_output=True, timeout=600
    )
    content = pdf.read_bytes()
    boxes = {box.split(b"]")[0] for box in content.split(b"/MediaBox [")[1:]}
    assert boxes and all(abs(float(box.split()[2]) - 595) < 1 and abs(float(box.split()[3]) - 842) < 1 for box in boxes)


def stated_in(path: Path) -> np.ndarray:
    """The covariance matrix of a DCC."""
    columns = ElementTree.parse(path).getroot().findall(".//si:covarianceMatrix/si:column", SPACES)
    return np.transpose([[float(entry.findtext("si:value", "", SPACES)) for entry in column] for column in columns])


def test_the_dcc_holds_the_same_numbers(tumblecal, calibrated, admin):
    assert tumblecal("certificate", calibrated, "--admin", admin).code == 0
    root = ElementTree.parse(calibrated / "dcc.xml").getroot()
    own = read_calibration(calibrated / "calibration.json").sensor.of(SENSOR)
    reals = root.findall(".//si:realList/si:real", SPACES)
    assert [real.findtext("si:label", None, SPACES) for real in reals] == list(SENSOR)
    values, expanded, factors = (
        np.array([float(real.findtext(key, "", SPACES)) for real in reals])
        for key in ("si:value", "si:expandedUnc/si:uncertainty", "si:expandedUnc/si:coverageFactor")
    )
    np.testing.assert_allclose(values, own.values * UNITS, rtol=1e-14)
    np.testing.assert_allclose(expanded, 1.959964 * own.sd * UNITS, rtol=1e-6)
    np.testing.assert_allclose(factors, 1.96, atol=1e-4)
    np.testing.assert_allclose(stated_in(calibrated / "dcc.xml"), own.covariance * np.outer(UNITS, UNITS), rtol=1e-13)
    from scipy.stats import chi2

    radius = float(root.findtext(".//si:ellipsoidalRegion/si:coverageFactor", "", SPACES))
    assert radius == pytest.approx(chi2.ppf(0.95, 9) ** 0.5, abs=1e-4)


def test_estimated_noise_is_covered_by_student_s_t(tumblecal, tmp_path, table1_file, admin):
    tumblecal("calibrate", table1_file, "--no-figures", "--out", tmp_path / "c")
    from scipy.stats import t

    assert results_of(tmp_path / "c", None, {}).tables[0].results[0].k == pytest.approx(t.ppf(0.975, 57))
    outcome = tumblecal("certificate", tmp_path / "c", "--admin", admin)
    assert outcome.code == 0 and "the gravity of the site is not stated" in outcome.lines[0]


def test_a_budget_s_uncertainties_are_taken(tumblecal, tmp_path, calibrated, admin, configs):
    given = ["budget", tmp_path / "positions.csv", configs / "considered_lab.toml", "--noise-sd", "0.1mg"]
    assert tumblecal(*given, "--out", tmp_path / "b").code == 0
    budget = json.loads((tmp_path / "b" / "budget.json").read_text())["parameters"]
    outcome = tumblecal("certificate", calibrated, "--admin", admin, "--budget", tmp_path / "b" / "budget.json")
    assert outcome.code == 0 and "type A" not in outcome.out
    results = results_of(calibrated, tmp_path / "b" / "budget.json", {})
    for result in results.tables[0].results:
        assert result.expanded == pytest.approx(budget[result.name]["U"], rel=1e-6)
    other = json.loads((tmp_path / "b" / "budget.json").read_text())
    other["source"]["sha256"] = "0" * 64
    (tmp_path / "other.json").write_text(json.dumps(other))
    outcome = tumblecal("certificate", calibrated, "--admin", admin, "--budget", tmp_path / "other.json")
    assert outcome.code == 2 and "its data differ from those of the calibration" in outcome.lines[0]


@pytest.mark.parametrize("case", CASES)
def test_certificates_of_every_kind_of_result_are_valid(tumblecal, tmp_path, folder_of, admin, configs, case):
    folder, said = folder_of(case), CASES[case]
    given = ["certificate", folder, "--admin", admin, "--out", tmp_path]
    outcome = tumblecal(*given, "--limits", configs / "certificate_limits.toml")
    assert outcome.code == 0, outcome.lines
    text = (tmp_path / "dcc.xml").read_text()
    assert said in text and said in (tmp_path / "certificate.html").read_text()
    stated, own = stated_in(tmp_path / "dcc.xml"), read_calibration(folder / "calibration.json").sensor
    np.testing.assert_allclose(stated, own.of(SENSOR).covariance * np.outer(UNITS, UNITS), rtol=1e-12)
    assert ("Hand-held attitudes, unknown" in text) == (case == "hand-held")
    if case == "ambiguous":
        assert "the data show one of: bias_drift.x and second_order.z; " in text
    mounts = len([name for name in own.names if name.startswith("dtheta")]) // 3
    assert mounts == {"hand-held": 0, "several mounts": 2}.get(case, 1)
    if (schema := schema_of_dcc()) is None:
        pytest.skip("xmlschema or the DCC schema files are not there; TUMBLECAL_SCHEMAS names their folder")
    schema.validate(str(tmp_path / "dcc.xml"))


def test_a_bias_that_moves_with_temperature_is_stated_with_the_temperature(tumblecal, calibrated, admin, configs):
    """The data's mean is 30 degC, the term counts from 25: on the page, in the DCC, and beside the verdict."""
    path = calibrated / "calibration.json"
    content = json.loads(path.read_text())
    bias = {"axis": "z", "coefficient": 2e-5, "powers": [0, 0, 0], "per_degc": True, "reference_degc": 25.0}
    cross = {"axis": "y", "coefficient": 1e-6, "powers": [1, 0, 0], "per_degc": True, "reference_degc": 25.0}
    drift = {"axis": "x", "coefficient": -3e-6, "powers": [1, 0, 0], "per_hour": True, "reference_s": 1800.0}
    content["provenance"]["temperature_range_degc"] = [10.0, 50.04]
    given = ["certificate", calibrated, "--admin", admin]
    for terms, said in (
        ([bias], "are valid at 25 degC: bias_z changes by 0.02 mg per degC (the data: 10 to 50 degC)."),
        (
            [{**cross, "effect": "of_user"}, drift],
            "are valid at 25 degC and time_s = 1800 s: the readings of axis y change (of_user) per degC, dK_x changes by "
            "-0.003e-3 per hour (the data: 10 to 50 degC).",
        ),
    ):
        path.write_text(json.dumps(content | {"temperature_degc": 30.0, "terms": terms}))
        assert tumblecal(*given).code == 0
        for file in ("certificate.html", "dcc.xml"):
            assert (calibrated / file).read_text().count(f"The values {said}") == 1
        assert tumblecal(*given, "--limits", configs / "certificate_limits.toml").code == 0
        for file in ("certificate.html", "dcc.xml"):
            assert (calibrated / file).read_text().count(f"The values, and the statement of conformity, {said}") == 2
        if (schema := schema_of_dcc()) is not None:
            schema.validate(str(calibrated / "dcc.xml"))


def test_the_decision_rule():
    verdicts = [Result("x", "1", value, 2.0, 2.0, 10.0).conformity for value in (7.9, -8.1, 9.9, 10.1, -11.9, 12.1)]
    assert verdicts == ["pass", "conditionalPass", "conditionalPass", "conditionalFail", "conditionalFail", "fail"]
    assert Result("x", "1", 1.0, 2.0, 2.0).conformity is None and tuple(VERDICTS)[-1] == "fail"
