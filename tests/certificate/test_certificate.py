"""Certificates: what ISO/IEC 17025 asks stands on the page, the DCC is valid and holds the same numbers, the rule decides."""

import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tumblecal import InputError, read_rig, simulate
from tumblecal.certificate.admin import read_admin, read_limits
from tumblecal.certificate.results import VERDICTS, Result, results_of
from tumblecal.data import write_positions
from tumblecal.data.calibration import read_calibration
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.diagnosis import Diagnoser
from tumblecal.estimation import exact, problem_of
from tumblecal.planning import NextPlan
from tumblecal.report.diagnosis_files import write_diagnosis
from tumblecal.report.result_file import write_calibration_of


ROOT = Path(__file__).parents[2]
UNITS = np.array([9.8123 if name.startswith("bias") else 1.0 for name in SENSOR])  # as the DCC states them
SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}


def schema_folder() -> Path | None:
    """PTB's schema files (LGPL, not part of this repository), where they lie beside it."""
    stated = os.environ.get("TUMBLECAL_SCHEMAS")
    places = [Path(stated)] if stated else [ROOT / "shared" / "schemas", ROOT.parent / "shared" / "schemas"]
    return next((place for place in places if (place / "dcc.xsd").exists()), None)


@cache
def schema_of_dcc():
    """The official schema; None where it, or what reads it, is not at hand."""
    folder = schema_folder()
    if folder is None or importlib.util.find_spec("xmlschema") is None:
        return None
    import xmlschema

    return xmlschema.XMLSchema(str(folder / "dcc.xsd"))


# What the certificate says of each kind of result.
CASES = {
    "adequate": "The data do not contradict the nominal model.",
    "identified": "Beside the nominal model the data show: axis_perpendicularity; it is in the fitted model.",
    "ambiguous": ". The values are the mean over these, by their probabilities, and the uncertainty has their spread in it.",
    "hand-held": "The nominal model was fitted; no diagnosis was made.",
    "several mounts": "The nominal model was fitted; no diagnosis was made.",
}
HIDDEN = {"adequate": {}, "identified": {"axis_perpendicularity": (5e-4,)}}


@pytest.fixture(scope="module")
def folder_of(tmp_path_factory, configs):
    """Results as the commands write them, of simulated instruments of the rigs that come with the program."""
    diagnose, root = Diagnoser(), tmp_path_factory.mktemp("results")

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
            write_calibration_of(folder, exact.fit(problem_of(data, noise_sd=rig.noise_sd_g)))
        else:
            diagnosis = diagnose(data, noise_sd=rig.noise_sd_g)
            assert diagnosis.verdict == case
            write_diagnosis(folder, diagnosis, NextPlan(), figures=False)
        return folder

    return made


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
        [chromium, *asked, (calibrated / "certificate.html").as_uri()], check=True, capture_output=True, timeout=120
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
    for keys, to, words in (
        (("parameters", "bias_y", "k"), -2.0, "parameters.bias_y.k: -2.0 is no coverage factor"),
        (("parameters", "dK_x", "k"), 0.0, "parameters.dK_x.k: 0.0 is no coverage factor at a probability of 0.95"),
        (("parameters", "dK_x", "k"), float("nan"), "parameters.dK_x.k: nan is no coverage factor"),
        (("parameters", "dK_x", "k"), 1.0, "which is 1.96 or more; make the budget again"),
        (("parameters", "dK_x", "value"), "0", "parameters.value.0: '0' is not a number"),
        (("level",), 95, "level: 95 is not a probability"),
        (("type_b_covariance", 0, 0), -1.0, "type_b_covariance: not one"),
    ):
        other = table = json.loads((tmp_path / "b" / "budget.json").read_text())
        for key in keys[:-1]:
            table = table[key]
        table[keys[-1]] = to
        (tmp_path / "other.json").write_text(json.dumps(other))
        outcome = tumblecal("certificate", calibrated, "--admin", admin, "--budget", tmp_path / "other.json")
        assert outcome.code == 2 and f"{tmp_path / 'other.json'}: " in outcome.lines[0], outcome.lines
        assert words in outcome.lines[0], outcome.lines
    other = json.loads((tmp_path / "b" / "budget.json").read_text())
    other["source"]["sha256"] = "0" * 64
    (tmp_path / "other.json").write_text(json.dumps(other))
    outcome = tumblecal("certificate", calibrated, "--admin", admin, "--budget", tmp_path / "other.json")
    assert outcome.code == 2 and "a budget of other data" in outcome.lines[0]


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
    assert ("Attitudes by hand, not known" in text) == (case == "hand-held")
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
        ([bias], "hold at 25 degC: bias_z changes by 0.02 mg per degC (the data: 10 to 50 degC)."),
        (
            [{**cross, "effect": "of_user"}, drift],
            "hold at 25 degC and time_s = 1800 s: the readings of axis y change (of_user) per degC, dK_x changes by -0.003e-3 "
            "per hour (the data: 10 to 50 degC).",
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


@pytest.fixture
def calibrated_as(tumblecal, tmp_path, table1):
    """Table 1 with its readings changed, calibrated with these options."""

    def made(added=0.0, *options) -> Path:
        comments = {"serial_number": "A-17", "gravity_ms2": "9.8123", "gravity_source": "gravimeter"}
        data = tmp_path / "changed.csv"
        write_positions(data, replace(table1, comments=comments, readings=table1.readings + added))
        assert tumblecal("calibrate", data, "--no-figures", "--out", tmp_path / "c", *options).code == 0
        return tmp_path / "c"

    return made


def test_no_certificate_is_made_of_a_calibration_not_to_be_used(tumblecal, tmp_path, calibrated_as, admin, configs):
    folder, rig = calibrated_as(np.array([0.6, 0.0, 0.0]), "--noise-sd", "0.1mg"), tmp_path / "rig.toml"
    outcome = tumblecal("certificate", folder, "--admin", admin)
    assert outcome.code == 2 and len(outcome.lines) == 1 and not (folder / "dcc.xml").exists()
    assert "result.json: implausible: bias_x: no certificate is made" in outcome.lines[0]
    assert "state what is usual" in outcome.lines[0]
    # Whose items have such a bias says so, and gets the certificate.
    rig.write_text((configs / "paper24.toml").read_text() + '\n[usual]\nbias = "1 g"\n')
    folder = calibrated_as(np.array([0.6, 0.0, 0.0]), "--noise-sd", "0.1mg", "--rig", rig)
    assert tumblecal("certificate", folder, "--admin", admin).code == 0
    # Positions that hardly determine something: so judged by calibrate.
    result = json.loads((folder / "result.json").read_text())
    hardly = {"tone": "bad", "headline": "Do not use it: hardly determined.", "advice": "measure more", "refused": True}
    (folder / "result.json").write_text(json.dumps(result | {"judgement": hardly}))
    outcome = tumblecal("certificate", folder, "--admin", admin)
    assert outcome.code == 2 and "judgement: Do not use it: hardly determined. No certificate" in outcome.lines[0]
    (folder / "result.json").write_text(json.dumps(result | {"source": {"sha256": "0" * 64}}))
    outcome = tumblecal("certificate", folder, "--admin", admin)
    assert outcome.code == 2 and "result.json: of other data than calibration.json" in outcome.lines[0]


def test_a_judgement_that_is_not_good_stands_on_the_certificate(tumblecal, calibrated_as, admin):
    folder = calibrated_as(0.0, "--noise-sd", "0.01mg")
    outcome = tumblecal("certificate", folder, "--admin", admin)
    said = "Judgement of the calibration: Not yet: the residuals (chi2/dof) are"
    assert outcome.code == 0 and any("WARNING" in line and said in line for line in outcome.lines)
    for file in ("certificate.html", "dcc.xml"):
        assert (folder / file).read_text().count(said) == 1
    assert f"<strong>{said}" in (folder / "certificate.html").read_text()
    if (schema := schema_of_dcc()) is not None:
        schema.validate(str(folder / "dcc.xml"))


def test_a_good_judgement_adds_nothing(tumblecal, calibrated, admin):
    assert tumblecal("certificate", calibrated, "--admin", admin).code == 0
    assert "Judgement" not in (calibrated / "certificate.html").read_text() + (calibrated / "dcc.xml").read_text()


HEAD = """schema = "tumblecal.head/1"
made_of = ["A.csv"]
effects = ["index_gain"]
parameters = ["index_gain", "dbeta@45", "dbeta@77"]
units = ["mrad/rad", "mrad", "mrad"]
values = [0.0, 0.0, 0.0]
sd = [0.01, 10.0, 0.1]
covariance = [[1e-4, 0.0, 0.0], [0.0, 1e2, 0.0], [0.0, 0.0, 1e-2]]
"""


@pytest.mark.parametrize(
    ("noise", "said"),
    [
        (["--noise-sd", "0.1mg"], "with the covariance that is stated of them: index_gain, dbeta@45"),
        ([], "at their values, as exact: index_gain"),
    ],
    ids=["noise stated", "noise unknown"],
)
def test_errors_of_a_measured_head_are_stated(tumblecal, tmp_path, calibrated_as, admin, noise, said):
    (tmp_path / "head.toml").write_text(HEAD)
    folder = calibrated_as(0.0, *noise, "--head", tmp_path / "head.toml")
    assert tumblecal("certificate", folder, "--admin", admin).code == 0
    digest = hashlib.sha256(HEAD.encode()).hexdigest()
    for file, end in (("certificate.html", "</td>"), ("dcc.xml", "</dcc:content>")):
        text = (folder / file).read_text()
        words = f"measured errors of the dividing head ({tmp_path / 'head.toml'}, SHA-256 {digest}) went into the fit"
        assert f"; {words}, {said}{end}" in text
    diagnosed = tumblecal(
        "diagnose", tmp_path / "changed.csv", *noise, "--head", tmp_path / "head.toml", "--out", folder
    )
    assert diagnosed.code == 0
    head = read_calibration(folder / "calibration.json").provenance["head"]
    assert head["parameters"] == said.rpartition(": ")[2].split(", ") and head["exact"] == (not noise)


def test_the_decision_rule():
    verdicts = [Result("x", "1", value, 2.0, 2.0, 10.0).conformity for value in (7.9, -8.1, 9.9, 10.1, -11.9, 12.1)]
    assert verdicts == ["pass", "conditionalPass", "conditionalPass", "conditionalFail", "conditionalFail", "fail"]
    assert Result("x", "1", 1.0, 2.0, 2.0).conformity is None and tuple(VERDICTS)[-1] == "fail"


def test_a_limit_of_one_parameter_goes_before_that_of_its_group(tmp_path):
    path = tmp_path / "limits.toml"
    own, group = 'bias_x = "0.1 mg"', 'bias = "1 mg"'
    for lines in ((own, group), (group, own)):
        path.write_text("\n".join(['schema = "tumblecal.limits/1"', 'source = "s"', "[limits]", *lines]))
        assert read_limits(path)[1] == pytest.approx({"bias_x": 1e-4, "bias_y": 1e-3, "bias_z": 1e-3})


@pytest.mark.parametrize(
    ("dates", "faults"),
    [
        ({"begin": "25", "end": "21"}, ["performance.end: 2026-11-21 is before performance.begin 2026-11-25"]),
        ({"received": "21"}, ["performance.begin: 2026-11-20 is before performance.received 2026-11-21"]),
        ({"issued": "20"}, ["issued: 2026-11-20 is before performance.end 2026-11-21"]),
        ({"received": "29", "issued": "01"}, ["performance.begin: ", "issued: 2026-11-01 is before"]),
        ({"received": None, "issued": "21"}, []),
        ({"received": "20", "begin": "20", "end": "20", "issued": "20"}, []),
    ],
)
def test_dates_that_cannot_follow_each_other_are_refused(tmp_path, configs, dates, faults):
    text, path = (configs / "certificate_lab.toml").read_text(), tmp_path / "admin.toml"
    for key, day in dates.items():
        text = re.sub(rf"^{key} = .*", "" if day is None else f"{key} = 2026-11-{day}", text, flags=re.MULTILINE)
    path.write_text(text)
    if not faults:
        read_admin(path)
        return
    with pytest.raises(InputError) as error:
        read_admin(path)
    assert len(error.value.faults) == len(faults)
    assert all(f"{path}: {words}" in fault for fault, words in zip(error.value.faults, faults, strict=True))


def test_data_of_another_date_are_told(tumblecal, calibrated, admin):
    path = calibrated / "calibration.json"
    content = json.loads(path.read_text())
    for stated, told in (
        ("2026-11-20", False),
        ("2026-11-19", True),
        ("2026-11-22T09:00:00Z", False),  # still the 21st west of Greenwich
        ("2026-11-22T13:00:00Z", True),
        ("2026-11-19T09:00:00Z", True),
        ("2025-11-20T09:00:00+01:00", True),
    ):
        content["provenance"]["measured_utc"] = stated
        path.write_text(json.dumps(content))
        outcome = tumblecal("certificate", calibrated, "--admin", admin)
        warned = [
            line for line in outcome.lines if f"were measured at {stated}, not from 2026-11-20 to 2026-11-21" in line
        ]
        assert outcome.code == 0 and len(warned) == told, (stated, outcome.lines)
    content["provenance"]["measured_utc"] = "yesterday"
    path.write_text(json.dumps(content))
    outcome = tumblecal("certificate", calibrated, "--admin", admin)
    assert outcome.code == 2 and "calibration.json: provenance.measured_utc: 'yesterday' is no date" in outcome.lines[0]


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
