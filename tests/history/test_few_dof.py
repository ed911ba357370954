"""Noise estimated from few degrees of freedom: what did not move is not said to have moved, and what moved still is."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import fdtrc, gammaincc, stdtrit
from test_history import covariance, results

from tumblecal import InputError
from tumblecal.data import write_positions
from tumblecal.data.calibration import read_calibration
from tumblecal.history.database import add, of_unit
from tumblecal.history.few_dof import joint_dof, no_change
from tumblecal.history.repeatability import PAPER_LIMITS, unit_history
from tumblecal.show.history import words_of_history


INF = float("inf")


def test_stated_noise_is_chi_square_and_one_estimated_noise_is_f():
    own, other = covariance()[:3, :3], covariance()[:3, :3]
    change = np.array([1e-4, -2e-4, 5e-5])
    t2 = float(change @ np.linalg.solve(own + other, change))
    assert no_change(change, [own, other], [INF, INF]) == (pytest.approx(t2), 3, pytest.approx(gammaincc(1.5, t2 / 2)))
    # One law between them: of many degrees of freedom it is chi-square.
    assert no_change(change, [own, other], [1e6, 1e6])[2] == pytest.approx(gammaincc(1.5, t2 / 2), rel=1e-4)
    alone = float(change @ np.linalg.solve(own, change))
    for pair, dofs in (([own, 0 * own], [4.0, INF]), ([0 * own, own], [INF, 4.0])):
        assert no_change(change, pair, dofs)[2] == pytest.approx(fdtrc(3, 4, alone / 3), rel=1e-9)
    # Both in one shape and of nearly one of them: the integral meets the closed form.
    assert no_change(change, [own, 1e-7 * own], [4.0, INF])[2] == pytest.approx(fdtrc(3, 4, alone / 3), rel=1e-3)
    assert no_change(change, [own, other], [3.0, 8.0])[2] == pytest.approx(
        no_change(-change, [other, own], [8.0, 3.0])[2], rel=1e-9
    )
    assert no_change(change, [0 * own, 0 * own], [3.0, 3.0]) == (0.0, 0, None)


def test_the_behrens_fisher_law_is_that_of_two_student_distributions():
    """What propagation of distributions gives (JCGM 101): the difference of two scaled Student variables."""
    rng, sds, dofs = np.random.default_rng(3), (1.0, 0.6), (4.0, 7.0)
    drawn = [sd * rng.standard_t(dof, 400_000) for sd, dof in zip(sds, dofs, strict=True)]
    for size in (0.5, 2.0, 5.0):
        tail = no_change(np.array([size]), [np.array([[sd**2]]) for sd in sds], dofs)[2]
        share = np.mean(np.abs(drawn[1] - drawn[0]) > size)
        assert tail == pytest.approx(share, abs=4 * np.sqrt(share / 400_000))


def test_the_file_states_the_degrees_of_freedom_and_compare_takes_them(tumblecal, tmp_path, table1):
    write_positions(data := tmp_path / "data.csv", table1)
    for folder, noise in (("estimated", ()), ("stated", ("--noise-sd", "0.1 mg"))):
        assert tumblecal("calibrate", data, *noise, "--no-figures", "--out", tmp_path / folder).code == 0
    files = {name: tmp_path / name / "calibration.json" for name in ("estimated", "stated")}
    dof = json.loads((tmp_path / "estimated" / "result.json").read_text())["noise"]["dof"]
    assert json.loads(files["estimated"].read_text())["provenance"]["dof"] == dof
    assert json.loads(files["stated"].read_text())["provenance"]["dof"] is None
    assert read_calibration(files["estimated"]).sensor.dof == dof
    assert read_calibration(files["stated"]).sensor.dof == INF
    said = tumblecal("compare", files["stated"], files["estimated"]).out
    words = f"its noise was estimated from {dof} degrees of freedom"
    assert said.count(words) == 1
    content = json.loads(files["estimated"].read_text())
    (tmp_path / "estimated" / "result.json").unlink()
    del content["provenance"]["dof"]
    files["estimated"].write_text(json.dumps(content))
    assert words not in tumblecal("compare", files["stated"], files["estimated"]).out
    assert read_calibration(files["estimated"]).dof is None
    for wrong in (0, -3, "3", True):
        files["estimated"].write_text(json.dumps(content | {"provenance": {"dof": wrong}}))
        with pytest.raises(InputError, match="dof: "):
            read_calibration(files["estimated"])


def test_a_history_takes_the_degrees_of_freedom_of_its_files(tmp_path):
    first, second, third = results(3)
    noise = {"names": list(first.parameters.names), "covariance": (first.parameters.covariance / 4).tolist()}
    add(
        tmp_path / "lab.db",
        replace(first, documents={"calibration.json": json.dumps({"provenance": {"dof": 3}, "parameters": noise})}),
    )
    add(tmp_path / "lab.db", replace(second, documents={"calibration.json": "{}"}))
    budgeted = {"calibration.json": json.dumps({"provenance": {"dof": 5}, "parameters": noise}), "budget.json": "{}"}
    add(tmp_path / "lab.db", replace(third, documents=budgeted))
    kept = [entry.parameters for entry in of_unit(tmp_path / "lab.db", "A-17")]
    assert [own.dof for own in kept] == [3, INF, 5] and [own.noise is None for own in kept] == [True, True, False]
    # Noise is a quarter of the combined variance: 16 times the degrees of freedom (Welch-Satterthwaite).
    np.testing.assert_allclose(kept[2].effective_dof, 80.0)
    assert joint_dof(kept[2], np.eye(12)) == pytest.approx(80.0)
    judged = unit_history(of_unit(tmp_path / "lab.db", "A-17"), PAPER_LIMITS)
    assert "of 2 results was estimated from 3 to 5 degrees" in words_of_history("A-17", judged, 0.05).text("evidence")


def test_e_n_takes_student_s_k():
    entries = [replace(own, parameters=replace(own.parameters, dof=3.0)) for own in results(5)]
    trend, known = (unit_history(own, PAPER_LIMITS).trends[0] for own in (entries, results(5)))
    k = stdtrit(3, 0.5 + 0.9545 / 2)
    np.testing.assert_allclose(trend.expanded, k * trend.sd, rtol=1e-3)
    np.testing.assert_array_equal(known.expanded, 2 * known.sd)
    between = unit_history(entries, PAPER_LIMITS).repeats[0].between
    together = np.hypot(k * np.hypot(*trend.sd[:2]), 2 * np.sqrt(2) * between)
    assert trend.en[0] == pytest.approx(np.diff(trend.values)[0] / together, rel=1e-3)
