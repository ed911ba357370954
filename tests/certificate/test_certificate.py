"""Certificates: what ISO/IEC 17025 asks stands on the page, the DCC is valid and holds the same numbers, the rule decides."""

import json
import os
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tumblecal.certificate.results import VERDICTS, Result, results_of
from tumblecal.data import write_positions
from tumblecal.data.calibration import read_calibration, write_calibration
from tumblecal.data.sensor_parameters import SENSOR


ROOT = Path(__file__).parents[2]
SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}


def schema_folder() -> Path | None:
    """PTB's schema files (LGPL, not part of this repository), where they lie beside it."""
    stated = os.environ.get("TUMBLECAL_SCHEMAS")
    places = [Path(stated)] if stated else [ROOT / "shared" / "schemas", ROOT.parent / "shared" / "schemas"]
    return next((place for place in places if (place / "dcc.xsd").exists()), None)


@pytest.fixture(scope="module")
def schema():
    xmlschema = pytest.importorskip("xmlschema", reason="xmlschema (extra dev) is not installed")
    if (folder := schema_folder()) is None:
        pytest.skip("the DCC schema files are not beside the repository; TUMBLECAL_SCHEMAS names their folder")
    return xmlschema.XMLSchema(str(folder / "dcc.xsd"))


@pytest.fixture
def admin(tmp_path, configs):
    path = tmp_path / "admin.toml"
    text = (configs / "certificate_lab.toml").read_text()
    path.write_text(
        text.replace('model = "M-3"', 'model = "M-3"\nserial_number = "A-17"').replace("Sons", '<Sons> & \\"Co\\"')
    )
    return path


@pytest.fixture
def calibrated(tumblecal, tmp_path, table1):
    data = tmp_path / "positions.csv"
    comments = {"serial_number": "A-17", "gravity_ms2": "9.8123", "gravity_source": "gravimeter"}
    write_positions(data, replace(table1, comments=comments))
    assert tumblecal("calibrate", data, "--no-figures", "--out", tmp_path / "c", "--noise-sd", "0.1mg").code == 0
    return tmp_path / "c"


def test_the_page_has_what_17025_asks_and_prints_on_a4(tumblecal, tmp_path, calibrated, admin, configs):
    outcome = tumblecal("certificate", calibrated, "--admin", admin, "--limits", configs / "certificate_limits.toml")
    assert outcome.code == 0, outcome.lines
    assert "type A" in outcome.out and "conformity: conditionalFail" not in outcome.out
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
        [chromium, *asked, (calibrated / "certificate.html").as_uri()], check=True, capture_output=True, timeout=120
    )
    content = pdf.read_bytes()
    boxes = {box.split(b"]")[0] for box in content.split(b"/MediaBox [")[1:]}
    assert boxes and all(abs(float(box.split()[2]) - 595) < 1 and abs(float(box.split()[3]) - 842) < 1 for box in boxes)


def test_the_dcc_holds_the_same_numbers(tumblecal, calibrated, admin):
    assert tumblecal("certificate", calibrated, "--admin", admin).code == 0
    root = ElementTree.parse(calibrated / "dcc.xml").getroot()
    own = read_calibration(calibrated / "calibration.json").sensor.of(SENSOR)
    units = np.array([9.8123 if name.startswith("bias") else 1.0 for name in SENSOR])
    reals = root.findall(".//si:realList/si:real", SPACES)
    assert [real.findtext("si:label", None, SPACES) for real in reals] == list(SENSOR)
    values, expanded, factors = (
        np.array([float(real.findtext(key, "", SPACES)) for real in reals])
        for key in ("si:value", "si:expandedUnc/si:uncertainty", "si:expandedUnc/si:coverageFactor")
    )
    np.testing.assert_allclose(values, own.values * units, rtol=1e-14)
    np.testing.assert_allclose(expanded, 1.959964 * own.sd * units, rtol=1e-6)
    np.testing.assert_allclose(factors, 1.96, atol=1e-4)
    columns = root.findall(".//si:covarianceMatrix/si:column", SPACES)
    matrix = [[float(entry.findtext("si:value", "", SPACES)) for entry in column] for column in columns]
    np.testing.assert_allclose(np.transpose(matrix), own.covariance * np.outer(units, units), rtol=1e-13)
    from scipy.stats import chi2

    radius = float(root.findtext(".//si:ellipsoidalRegion/si:coverageFactor", "", SPACES))
    assert radius == pytest.approx(chi2.ppf(0.95, 9) ** 0.5, abs=1e-4)


def test_estimated_noise_is_covered_by_student_s_t(tumblecal, tmp_path, table1_file, admin):
    tumblecal("calibrate", table1_file, "--no-figures", "--out", tmp_path / "c")
    from scipy.stats import t

    assert results_of(tmp_path / "c", None, {}).results[0].k == pytest.approx(t.ppf(0.975, 57))
    outcome = tumblecal("certificate", tmp_path / "c", "--admin", admin)
    assert outcome.code == 0 and "nobody stated the gravity" in outcome.lines[0]


def test_a_budget_s_uncertainties_are_taken(tumblecal, tmp_path, calibrated, admin, configs):
    given = ["budget", tmp_path / "positions.csv", configs / "considered_lab.toml", "--noise-sd", "0.1mg"]
    assert tumblecal(*given, "--out", tmp_path / "b").code == 0
    budget = json.loads((tmp_path / "b" / "budget.json").read_text())["parameters"]
    outcome = tumblecal("certificate", calibrated, "--admin", admin, "--budget", tmp_path / "b" / "budget.json")
    assert outcome.code == 0 and "type A" not in outcome.out
    results = results_of(calibrated, tmp_path / "b" / "budget.json", {})
    for result in results.results:
        assert result.expanded == pytest.approx(budget[result.name]["U"], rel=1e-6)
    other = json.loads((tmp_path / "b" / "budget.json").read_text())
    other["source"]["sha256"] = "0" * 64
    (tmp_path / "other.json").write_text(json.dumps(other))
    outcome = tumblecal("certificate", calibrated, "--admin", admin, "--budget", tmp_path / "other.json")
    assert outcome.code == 2 and "a budget of other data" in outcome.lines[0]


@pytest.mark.parametrize("case", ["adequate", "identified", "ambiguous", "hand-held", "several mounts"])
def test_certificates_of_every_kind_of_result_are_valid(tumblecal, tmp_path, calibrated, admin, configs, schema, case):
    folder, limits = calibrated, ["--limits", configs / "certificate_limits.toml"]
    if case in ("hand-held", "several mounts"):
        own = read_calibration(calibrated / "calibration.json")
        assert own.parameters is not None
        names = [name for name in own.parameters.names if name in SENSOR]
        if case == "several mounts":
            names = list(own.parameters.names)
        parameters = own.parameters.of(names)
        labels = tuple(f"{name}@mount=B" if name not in SENSOR else name for name in names)
        write_calibration(
            calibrated / "calibration.json",
            replace(own, alignment=None, parameters=replace(parameters, names=labels)),
        )
        limits = []
    else:
        causes = [] if case == "adequate" else ["second_order.x", "third_order.x"]
        (folder / "diagnosis.json").write_text(json.dumps({"verdict": case, "causes": causes}))
    outcome = tumblecal("certificate", folder, "--admin", admin, *limits)
    assert outcome.code == 0, outcome.lines
    schema.validate(str(folder / "dcc.xml"))
    text = (folder / "dcc.xml").read_text()
    assert ("second_order.x" in text) == (case in ("identified", "ambiguous"))


def test_the_decision_rule():
    verdicts = [Result("x", "1", value, 2.0, 2.0, 10.0).conformity for value in (7.9, -8.1, 9.9, 10.1, -11.9, 12.1)]
    assert verdicts == ["pass", "conditionalPass", "conditionalPass", "conditionalFail", "conditionalFail", "fail"]
    assert Result("x", "1", 1.0, 2.0, 2.0).conformity is None and VERDICTS[-1] == "fail"


def test_mistakes_are_one_line(tumblecal, tmp_path, calibrated, admin, configs):
    text = admin.read_text()
    for change, words in (
        (text.replace('id = "ACC-2026-0117"', 'id = ""'), "id: "),
        (text.replace('country = "AT"', 'country = "at"'), "country"),
        (text.replace('"A-17"', '"B-2"'), "is of unit A-17"),
        (text.replace("traceability", "trace"), "traceability: is missing"),
        (text.replace("2026-11-21", "2026-13-21"), "not TOML"),
    ):
        path = tmp_path / "wrong.toml"
        path.write_text(change)
        outcome = tumblecal("certificate", calibrated, "--admin", path)
        assert outcome.code == 2 and outcome.lines and any(words in line for line in outcome.lines), outcome.lines
    limits = tmp_path / "limits.toml"
    for own, words in (
        ('dB = "1 mg"', "limits.dB: no parameter"),
        ('bias = "1 mrad"', "measure different"),
        ('dK = "0"', "above 0"),
    ):
        limits.write_text(f'schema = "tumblecal.limits/1"\nsource = "s"\n[limits]\n{own}\n')
        outcome = tumblecal("certificate", calibrated, "--admin", admin, "--limits", limits)
        assert outcome.code == 2 and words in outcome.lines[0]
    outcome = tumblecal("certificate", tmp_path, "--admin", admin)
    assert outcome.code == 2 and "calibration.json: no such file" in outcome.lines[0]
    assert not (calibrated / "dcc.xml").exists()
