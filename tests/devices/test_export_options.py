"""`tumblecal export`: the gravity that a calibration states, and options on which nothing depends."""

from dataclasses import replace

import numpy as np
from test_targets import G, unit

from tumblecal.data.calibration import write_calibration
from tumblecal.ground.gravity import STANDARD, Gravity


def test_one_g_is_the_calibration_s_where_it_says_so(tumblecal, tmp_path):
    """The bias was measured at that gravity: in m/s^2 it is the same wherever the device goes."""
    path, own = tmp_path / "calibration.json", unit()
    for its, option, words in (
        (Gravity(G, "stated"), "9.79", "remove this option"),
        (STANDARD, "9.79", "calibrate again with --gravity"),
    ):
        write_calibration(path, replace(own, gravity=its))
        outcome = tumblecal("export", path, "--to", "ros", "--gravity", option, "--out", tmp_path / "unit.yaml")
        assert outcome.code == 2 and len(outcome.lines) == 1 and words in outcome.lines[0]
        assert f"one g of {path} is {its}" in outcome.lines[0] and not (tmp_path / "unit.yaml").exists()
    for its, option, right in ((Gravity(G, "stated"), "9.8124", G), (None, "9.79", 9.79)):
        write_calibration(path, replace(own, gravity=its))
        outcome = tumblecal("export", path, "--to", "imu_tk", "--gravity", option)
        np.testing.assert_allclose(np.array(outcome.out.split()[-3:], float), own.bias * right, rtol=1e-12)


def test_drift_terms_are_a_loss_not_a_fault(tumblecal, tmp_path):
    path = tmp_path / "calibration.json"
    drift = {"axis": "x", "coefficient": 1e-3, "powers": [0, 0, 0], "per_hour": True, "reference_s": 0.0}
    own = unit()
    write_calibration(path, replace(own, matrix=np.eye(3), extra={"terms": [drift]}))
    said = tumblecal("export", path, "--to", "csv", "--out", tmp_path / "unit.csv").out
    assert (
        "lost: drift: up to 1 mg per h" in said
        and "lost: drift: up to 1 mg per h" in (tmp_path / "unit.csv").read_text()
    )
    said = tumblecal("export", path, "--to", "csv", "--run-time", "30 min", "--out", tmp_path / "unit.csv").out
    assert "lost: drift, over 0.5 h: up to 0.5 mg\n" in said
    write_calibration(path, own)
    said = tumblecal("export", path, "--to", "csv", "--run-time", "8 h", "--out", tmp_path / "unit.csv").out
    assert "--run-time: no effect on the export of this calibration to csv" in said
