"""What calibrate and diagnose said of a calibration, and of the head it was made on, reaches its certificate."""

import hashlib
import json

import numpy as np
import pytest


def test_no_certificate_is_made_of_a_calibration_not_to_be_used(tumblecal, tmp_path, calibrated_as, admin, configs):
    folder, rig = calibrated_as(np.array([0.8, 0.0, 0.0]), "--noise-sd", "0.1mg"), tmp_path / "rig.toml"
    outcome = tumblecal("certificate", folder, "--admin", admin)
    assert outcome.code == 2 and len(outcome.lines) == 1 and not (folder / "dcc.xml").exists()
    assert "calibration.json: use: no: implausible values of bias_x." in outcome.lines[0]
    # It is made for who insists, and says so.
    outcome = tumblecal("certificate", folder, "--admin", admin, "--use-anyway")
    assert outcome.code == 0 and "use: no: implausible values of bias_x" in outcome.out
    assert "Use of the calibration: no: implausible values of bias_x." in (folder / "certificate.html").read_text()
    # A file that does not state its use: the result in its folder does.
    stated = json.loads((folder / "calibration.json").read_text())
    (folder / "calibration.json").write_text(json.dumps({k: own for k, own in stated.items() if k != "use"}))
    outcome = tumblecal("certificate", folder, "--admin", admin)
    assert outcome.code == 2 and "result.json: judgement: Do not use it" in outcome.lines[0]
    # Whose items have such a bias says so, and gets the certificate.
    rig.write_text((configs / "paper24.toml").read_text() + '\n[usual]\nbias = "1 g"\n')
    folder = calibrated_as(np.array([0.8, 0.0, 0.0]), "--noise-sd", "0.1mg", "--rig", rig)
    assert tumblecal("certificate", folder, "--admin", admin).code == 0
    # Positions that hardly determine something: so judged by calibrate.
    result = json.loads((folder / "result.json").read_text())
    hardly = {"tone": "bad", "headline": "Do not use it: hardly determined.", "advice": "measure more", "refused": True}
    (folder / "result.json").write_text(json.dumps(result | {"judgement": hardly}))
    outcome = tumblecal("certificate", folder, "--admin", admin)
    assert outcome.code == 2 and "judgement: Do not use it: hardly determined. No certificate" in outcome.lines[0]
    (folder / "result.json").write_text(json.dumps(result | {"source": result["source"] | {"sha256": "0" * 64}}))
    (tmp_path / "log.csv").write_text(
        "time_s,ax_g,ay_g,az_g\n" + "".join(f"{k / 100},0.9,0.0,1.0\n" for k in range(50))
    )
    for command in (
        ("certificate", folder, "--admin", admin),
        ("history", tmp_path / "lab.db", "--add", folder),
        ("export", folder / "calibration.json", "--to", "csv"),
        ("apply", folder / "calibration.json", tmp_path / "log.csv"),
        ("compare", folder / "calibration.json", folder / "calibration.json"),
    ):
        outcome = tumblecal(*command)
        assert outcome.code == 2 and "result.json: its data differ from those of calibration.json" in outcome.lines[0]


HEAD = """schema = "tumblecal.head/1"
made_of = ["A.csv"]
effects = ["index_gain"]
parameters = ["index_gain", "dbeta@45", "dbeta@77"]
units = ["mrad/rad", "mrad", "mrad"]
values = [0.0, 0.0, 0.0]
sd = [0.01, 10.0, 0.1]
covariance = [[1e-4, 0.0, 0.0], [0.0, 1e2, 0.0], [0.0, 0.0, 1e-2]]
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("noise", "said"),
    [
        (["--noise-sd", "0.1mg"], "with their stated covariance: index_gain, dbeta@45"),
        ([], "treated as exact: index_gain"),
    ],
    ids=["noise stated", "noise unknown"],
)
def test_errors_of_a_measured_head_are_stated(tumblecal, tmp_path, calibrated_as, admin, noise, said):
    (tmp_path / "head.toml").write_text(HEAD)
    folder = calibrated_as(0.0, *noise, "--head", tmp_path / "head.toml")
    assert tumblecal("certificate", folder, "--admin", admin).code == 0
    page = (folder / "certificate.html").read_text()
    held = "data and the covariance of the measured errors of the head." if noise else "data only (type A)."
    assert f"from the noise of the {held}" in page
    digest = hashlib.sha256(HEAD.encode()).hexdigest()
    for file, end in (("certificate.html", "</td>"), ("dcc.xml", "</dcc:content>")):
        text = (folder / file).read_text()
        words = f"the fit includes measured errors of the dividing head ({tmp_path / 'head.toml'}, SHA-256 {digest})"
        assert f"; {words}, {said}{end}" in text


def test_certificate_compare_and_history_state_corrections_that_the_file_lacks_and_the_noise_level(
    tumblecal, tmp_path, admin, calibrated
):
    """As `apply` and `export` do; `calibrate` and `diagnose` write them where a fitted effect has no term."""
    path = calibrated / "calibration.json"
    content = json.loads(path.read_text())
    loss = {"effect": "memory.y", "reason": "it depends on the position before", "largest_mg": 0.4, "rms_mg": 0.1}
    content["provenance"] |= {
        "not_applied": ["memory.y"],
        "losses": [loss],
        "dof": 57,
        "stated_noise": "It is 14 times too large",
    }
    path.write_text(json.dumps(content))
    said = "not in this calibration: memory.y (up to 0.4 mg, 0.1 mg rms, it depends on the position before)"
    certified = tumblecal("certificate", calibrated, "--admin", admin)
    assert certified.code == 0 and said in certified.out
    for name in ("certificate.html", "dcc.xml"):
        page = (calibrated / name).read_text()
        assert said[1:] in page
        assert "level is estimated from the residuals, with 57 degrees of freedom. It is 14 times too large." in page
    assert tumblecal("compare", path, path).out.count(f"{path}: {said}") == 2
    assert tumblecal("history", tmp_path / "lab.db", "--add", calibrated).code == 0
    listed = " ".join(tumblecal("history", tmp_path / "lab.db").out.split())
    assert "not in this calibration: memory.y (up to 0.4 mg, 0.1 mg rms); use: yes" in listed
