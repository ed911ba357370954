"""`tumblecal check` of positions in unknown attitudes, with a calibration that is written here: files, updates, refusals."""

import hashlib
import json
import re

import numpy as np
import pytest
from test_check import SD, VALUES, by_hand, calibration, noise

from tumblecal.data import write_positions
from tumblecal.data.calibration import read_calibration, write_calibration
from tumblecal.data.sensor_parameters import SENSOR


BIAS_Z = 2e-3 * (np.arange(9) == 5)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A calibration, a recording half a year later, and one after the bias of z has changed."""
    monkeypatch.chdir(tmp_path)
    stated = {"dof": None, "sigma_g": SD, "measured_utc": "2026-03-30"}
    write_calibration(tmp_path / "c.json", calibration(serial_number="A-17", provenance=stated))
    comments = {"attitudes": "unknown", "serial_number": "A-17", "measured_utc": "2026-09-30"}
    for name, change in (("same", 0 * BIAS_Z), ("changed", BIAS_Z)):
        write_positions(tmp_path / f"{name}.csv", by_hand(VALUES + change, noise(2), comments=comments))
    return tmp_path


def test_an_agreement_is_updated_with_the_stated_drift_and_kept_in_the_history(tumblecal, folder):
    given = ("--update", "new.json", "--drift", "bias=0.02 mg/month", "--history", "lab.db", "--out", "k")
    outcome = tumblecal("check", "c.json", "same.csv", *given)
    assert outcome.code == 0 and "written: k/: check.json, check.html; new.json" in outcome.out, outcome.lines
    record = json.loads((folder / "k" / "check.json").read_text())
    digest = hashlib.sha256((folder / "same.csv").read_bytes()).hexdigest()
    assert record["use"]["answer"] == "yes" and record["recording"][0]["sha256"] == digest
    old, new = (read_calibration(folder / name).sensor.of(SENSOR) for name in ("c.json", "new.json"))
    assert np.all(np.abs(new.values - old.values) < 3 * old.sd) and np.all(new.sd[3:6] < old.sd[3:6])
    update = read_calibration(folder / "new.json").provenance["update"]
    # Six months are 184 days of 365.25/12 a month.
    assert update["process_noise"]["sd"]["bias_x"] == pytest.approx(0.02e-3 * 184 / (365.25 / 12))
    assert re.search(r"2026-09-30.*A-17 +check .*agrees", tumblecal("history", "lab.db").out)
    # The update is checked by new data: not by the recording that it was made with.
    again = tumblecal("check", "new.json", "same.csv", "--out", "again")
    assert again.code == 2 and "was made from this file" in again.lines[-1]
    # A history of one result states no drift.
    assert tumblecal("check", "c.json", "same.csv", "--update", "n.json", "--history", "lab.db", "--out", "h").code == 0
    assert np.all(
        np.array([*read_calibration(folder / "n.json").provenance["update"]["process_noise"]["sd"].values()]) == 0
    )


def test_a_changed_bias_is_updated_only_if_it_is_free(tumblecal, folder):
    refused = tumblecal("check", "c.json", "changed.csv", "--update", "new.json", "--out", "k", "--no-figures")
    assert refused.code == 2 and "contradicts the calibration" in refused.lines[-1]
    assert (folder / "k" / "check.json").exists() and not (folder / "new.json").exists()
    outcome = tumblecal("check", "c.json", "changed.csv", "--update", "new.json", "--free", "bias_z", "--out", "k")
    assert outcome.code == 3 and outcome.out.startswith("CHANGED")
    new = read_calibration(folder / "new.json").sensor.of(SENSOR)
    assert new.values[5] == pytest.approx(VALUES[5] + 2e-3, abs=3 * new.sd[5])
    accepted = tumblecal("check", "c.json", "changed.csv", "--largest-error", "5mg", "--out", "k")
    assert accepted.code == 0 and json.loads((folder / "k" / "check.json").read_text())["use"]["expanded_g"] > 2e-3
    repeated = tumblecal("check", "c.json", "changed.csv", "--repeatability", "bias=2 mg", "--out", "k")
    assert repeated.code == 0


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        (("--free", "bias_z"), "--free is for an update"),
        (("--drift", "bias=1 mg/month"), "--drift is for an update"),
        (("--update", "x.json", "--drift", "bias=3"), "--drift bias: '3' has no unit"),
        (("--update", "x.json", "--drift", "bias=-3 mg/month"), "must be above 0, or 0"),
        (("--update", "x.json", "--free", "tilt"), "no such parameter"),
        (("--update", "x.json", "--months", "2000"), "--months. Must be < 1200"),
        (("--update", "c.json"), "would overwrite the input"),
        (("--prior", "dbeta=3 arcmin"), "the angles of same.csv are unknown"),
        (("--u-gravity", "7"), "--u-gravity. Must be < 0.1"),
        (("--gravity", "9.8"), "no gravity is stated, so it cannot be compared"),
        (("--repeatability", "bias=3 deg"), "--repeatability bias: 'deg' cannot be converted"),
        (("--noise-sd", "3"), "--noise-sd: '3' has no unit"),
    ],
)
def test_unusable_options_are_one_line(tumblecal, folder, options, fault):
    outcome = tumblecal("check", "c.json", "same.csv", "--out", "k", *options)
    assert outcome.code == 2 and fault in outcome.lines[-1], outcome.lines
    assert not (folder / "x.json").exists()


def test_the_recording_of_another_unit_is_refused_unless_insisted(tumblecal, folder):
    other = (folder / "same.csv").read_text().replace("A-17", "B-2")
    (folder / "other.csv").write_text(other)
    outcome = tumblecal("check", "c.json", "other.csv", "--out", "k")
    assert outcome.code == 2 and "serial number B-2, but c.json is of A-17" in outcome.lines[-1]
    assert tumblecal("check", "c.json", "other.csv", "--other-unit", "--out", "k").code == 0
