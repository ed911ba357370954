"""A budget with the covariance of a diagnosis: its sum by hand, the same U on the certificate, and files that do not fit."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t

from tumblecal.certificate.results import results_of
from tumblecal.data.calibration import write_calibration
from tumblecal.data.calibration_use import Use
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.estimation import exact, problem_of
from tumblecal.estimation.linear_calibration import linear_calibration


# Two inputs whose shifts are known in closed form: of the scale factors alike, and of what is written.
LAB = """schema = "tumblecal.budget/1"
[considered]
gravity = { what = "gravity_value", size = "60 ppm", coverage = 2 }
use = { adds_to = "bias", size = "0.03 mg" }
"""
TYPE_B = {"dK": 30e-6, "bias": 0.03e-3}


@pytest.fixture(scope="module")
def fitted(table1):
    """Noise estimated, with 57 degrees of freedom."""
    return exact.fit(problem_of(table1))


@pytest.fixture
def folder(fitted, table1_file, tmp_path):
    """`calibration.json` as `diagnose` writes it, with contributions that are known; and what is changed in its provenance."""

    def written(**changed):
        random = np.random.default_rng(8).normal(0, 2e-5, (2, 12, 12))
        added = random @ random.swapaxes(1, 2)
        covariance = fitted.covariance.copy()
        covariance[:12, :12] += added.sum(axis=0)
        own = {"noise": fitted.covariance, "explanations": added[0], "undetected_effects": added[1]}
        parts = {
            part: dict(zip(fitted.names[:12], np.sqrt(np.diag(square)).tolist(), strict=False))
            for part, square in own.items()
        }
        said = {"verdict": "identified", "causes": ["second_order.y"], "uncertainty_parts": parts}
        said |= {
            "undetected_effects": ["base_levelling"],
            "sha256": hashlib.sha256(table1_file.read_bytes()).hexdigest(),
        }
        calibration = linear_calibration(replace(fitted, covariance=covariance))
        calibration = replace(calibration, provenance=calibration.provenance | said | changed, use=Use("yes"))
        (tmp_path / "d").mkdir(exist_ok=True)
        write_calibration(tmp_path / "d" / "calibration.json", calibration)
        return tmp_path / "d", covariance

    return written


def test_budget_and_certificate_state_the_covariance_of_the_diagnosis_and_type_b(
    tumblecal, folder, fitted, table1_file, tmp_path
):
    where, covariance = folder()
    (lab := tmp_path / "lab.toml").write_text(LAB)
    outcome = tumblecal("budget", table1_file, lab, "--diagnosis", where, "--out", tmp_path / "b")
    assert outcome.code == 0 and "use: yes" in outcome.out and "undetected effects" in outcome.out, outcome.lines
    assert "Undetected effects are not included" not in outcome.out
    assert "at most too large" not in outcome.out  # no input is one of the undetected effects
    budget = json.loads((tmp_path / "b" / "budget.json").read_text())
    assert list(budget["parameters"]) == list(fitted.names[:12])  # sensor and mount; not dbeta
    for k, (name, own) in enumerate(budget["parameters"].items()):
        type_b, from_diagnosis = TYPE_B.get(name.split("_")[0], 0.0), covariance[k, k]
        u = np.sqrt(from_diagnosis + type_b**2)
        assert own["u"] == pytest.approx(u, rel=1e-4)
        assert own["u_type_a"] == pytest.approx(fitted.sd[k], rel=1e-6)
        listed = [own["u_type_a"], *own["contributions"].values()]
        assert np.linalg.norm(listed) == pytest.approx(own["u"]) and len(listed) == 5
        dof = u**4 * 57 / from_diagnosis**2
        assert own["effective_dof"] == pytest.approx(dof, rel=1e-3)
        assert own["U"] == pytest.approx(t.ppf(0.975, dof) * u, rel=1e-4)
    whole = covariance[:12, :12] + np.array(budget["type_b_covariance"])
    np.testing.assert_allclose(budget["covariance"], whole, rtol=1e-9, atol=1e-20)
    certified = results_of(where, tmp_path / "b" / "budget.json", {})
    for result in certified.tables[0].results:
        own = budget["parameters"][result.name]
        assert (result.expanded, result.k) == pytest.approx((own["U"], own["k"]), rel=1e-9)
    assert "undetected effects" in certified.uncertainty_words
    places = [fitted.names.index(name) for name in SENSOR]
    np.testing.assert_allclose(certified.tables[0].covariance, np.array(budget["covariance"])[np.ix_(places, places)])
    assert "undetected effects" in (tmp_path / "b" / "budget.html").read_text()


def test_an_effect_is_not_counted_twice_in_silence(tumblecal, folder, table1_file, tmp_path):
    (lab := tmp_path / "lab.toml").write_text(LAB + 'level = { what = "base_levelling", size = "0.1 mrad" }\n')
    given = ["budget", table1_file, lab, "--diagnosis", folder()[0], "--out", tmp_path / "b"]
    outcome = tumblecal(*given)
    assert outcome.code == 0
    assert "input level (base_levelling) is also among the undetected effects" in outcome.out
    assert outcome.out.count("at most too large") == 1  # not of gravity
    assert "at most too large" in (tmp_path / "b" / "budget.html").read_text()
    lab.write_text(LAB + 'square = { what = "second_order", size = "0.1 mg/g^2" }\n')
    outcome = tumblecal(*given)
    assert outcome.code == 2 and len(outcome.lines) == 1
    assert "considered.square: second_order.y is in the explanation of" in outcome.lines[0]
