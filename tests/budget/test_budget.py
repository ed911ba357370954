"""Uncertainty budgets: contributions against fits of changed readings, intervals that hold the truth as often as they say."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest

import gimbal_bounds as gimbal
from tumblecal.budget.budget import budget_of
from tumblecal.budget.inputs import sensitivity_to_readings
from tumblecal.budget.monte_carlo import monte_carlo
from tumblecal.chain.considered import Considered
from tumblecal.data import write_positions
from tumblecal.effects.catalogue import catalogue
from tumblecal.estimation import exact, problem_of
from tumblecal.noise.covariance import Covariance


ENTRIES = catalogue()
LAB = """
gravity = { what = "gravity_value", size = "60 ppm", coverage = 2 }
levelling = { what = "base_levelling", size = "0.1 mrad", distribution = "rectangular" }
index = { what = "spindle_angle", size = "0.1 mrad", per = "position", distribution = "triangular" }
pitch = { what = "pitch_angle", size = "0.05 mrad", per = "position", dof = 12 }
flexure = { what = "fixture_flexure", size = "0.02 mrad/g", distribution = "arcsine" }
nonlinearity = { what = "second_order", size = "0.05 mg/g^2" }
floor = { what = "reading", size = "0.05 mg", per = "position" }
use = { adds_to = "bias", size = "0.03 mg" }
"""


def considered(text=LAB):
    return {label: Considered.model_validate(table) for label, table in tomllib.loads(text).items()}


@pytest.fixture(scope="module")
def stated(table1):
    return exact.fit(problem_of(table1, noise_sd=0.1e-3))


@pytest.fixture(scope="module")
def lab(stated):
    return budget_of(stated, considered(), ENTRIES, "lab.toml")


def test_each_shift_is_that_of_a_fit_to_changed_readings(table1, stated, lab):
    """The readings are changed here, by the physics of each input; only the fit is the program's."""
    truth = stated.values
    alpha, beta = np.radians(table1.alpha_deg), np.radians(table1.beta_deg) + np.repeat(truth[12:], 8)
    bias, scale = truth[3:6], 1 + truth[:3]
    triad = np.array([[1, 0, 0], [truth[9], 1, 0], [truth[10], truth[11], 1]])

    def readings(roll=0.0, spindle=0.0, pitch=0.0, second=0.0, larger=0.0):
        f = np.stack([np.zeros(24), np.zeros(24), np.full(24, 1 + larger)])
        f = np.stack([f[0], np.cos(roll) * f[1] + np.sin(roll) * f[2], np.cos(roll) * f[2] - np.sin(roll) * f[1]])
        b, a = beta + pitch, alpha + spindle
        f = np.stack([np.cos(b) * f[0] - np.sin(b) * f[2], f[1], np.sin(b) * f[0] + np.cos(b) * f[2]])
        f = np.stack([f[0], np.cos(a) * f[1] + np.sin(a) * f[2], np.cos(a) * f[2] - np.sin(a) * f[1]])
        x, y, z = truth[6:9]
        rz = np.array([[np.cos(z), np.sin(z), 0], [-np.sin(z), np.cos(z), 0], [0, 0, 1]])
        ry = np.array([[np.cos(y), 0, -np.sin(y)], [0, 1, 0], [np.sin(y), 0, np.cos(y)]])
        rx = np.array([[1, 0, 0], [0, np.cos(x), np.sin(x)], [0, -np.sin(x), np.cos(x)]])
        u = triad @ rx @ ry @ rz @ f
        return (scale[:, None] * u + second * np.array([[0], [1], [0]]) * u[1] ** 2).T + bias

    def moved(**change):
        changed, before = (
            exact.fit(problem_of(replace(table1, readings=readings(**own)), noise_sd=0.1e-3)).values
            for own in (change, {})
        )
        return changed - before

    labels = [given.label for given in lab.inputs]
    shift = dict(zip(labels, lab.shifts, strict=True))
    np.testing.assert_allclose(shift["gravity"][:, 0], moved(larger=30e-6), atol=3e-8)
    np.testing.assert_allclose(shift["levelling"][:, 0], moved(roll=1e-4 / 3**0.5), atol=3e-8)
    np.testing.assert_allclose(shift["nonlinearity"][:, 1], moved(second=0.05e-3), atol=3e-8)
    for position in (0, 5, 20):
        at = np.eye(24)[position]
        np.testing.assert_allclose(shift["index"][:, position], moved(spindle=at * 1e-4 / 6**0.5), atol=3e-8)
        np.testing.assert_allclose(shift["pitch"][:, position], moved(pitch=at * 0.05e-3), atol=3e-8)
    assert np.flatnonzero(np.abs(shift["gravity"][:, 0]) > 1e-7).tolist() == [0, 1, 2]  # all scale factors alike


def test_readings_of_correlated_noise_have_their_own_gain(table1):
    """What a changed reading does to the fit under covariances between positions, by fitting again."""
    rng = np.random.default_rng(5)
    whitening = 1e4 * (np.eye(24) + 0.2 * np.tril(rng.normal(size=(3, 24, 24)), -1))
    problem = replace(problem_of(table1, noise_sd=0.1e-3), whitening=whitening)
    fit = exact.fit(problem)
    changed = table1.readings.copy()
    changed[5, 1] += 1e-5
    moved = exact.fit(replace(problem, readings=changed)).values - fit.values
    np.testing.assert_allclose(sensitivity_to_readings(fit)[:, 5, 1] * 1e-5, moved, atol=1e-9)


def test_combined_expanded_and_degrees_of_freedom_by_hand(table1):
    fit = exact.fit(problem_of(table1))  # the noise estimated with 57 degrees of freedom
    made = budget_of(fit, considered('use = { adds_to = "bias_y", size = "0.05 mg", dof = 4 }'), ENTRIES, "x")
    j = fit.names.index("bias_y")
    u_a, u_b = fit.sd[j], 0.05e-3
    u = np.hypot(u_a, u_b)
    dof = u**4 / (u_a**4 / 57 + u_b**4 / 4)
    assert made.combined[j] == pytest.approx(u) and made.dof[j] == pytest.approx(dof)
    assert made.dof[j - 1] == pytest.approx(57)  # untouched
    from scipy.stats import t

    assert made.expanded[j] == pytest.approx(t.ppf(0.975, dof) * u)
    assert made.without_each[1, j] == pytest.approx(t.ppf(0.975, 57) * u_a)
    assert made.without_each[0, j] == pytest.approx(t.ppf(0.975, 4) * u_b)


@pytest.mark.parametrize(
    ("distribution", "standard"),
    [("normal", 0.5), ("rectangular", 3**-0.5), ("triangular", 6**-0.5), ("arcsine", 2**-0.5)],
)
def test_standard_uncertainties_of_distributions(distribution, standard):
    coverage = {"coverage": 2} if distribution == "normal" else {}
    own = Considered.model_validate({"what": "x", "size": "1 mg", "distribution": distribution, **coverage})
    assert own.standard == pytest.approx(standard)


@pytest.mark.long
def test_expanded_intervals_hold_the_truth_as_often_as_they_say(lab, table1):
    """2000 calibrations with noise and all inputs drawn: 95 %, stated noise and estimated."""
    for made in (lab, budget_of(exact.fit(problem_of(table1)), considered(), ENTRIES, "x")):
        trials = monte_carlo(made, 2000, seed=3)
        assert trials.failed == 0
        assert 0.94 < trials.within.mean() < 0.96
        assert np.all((trials.within > 0.93) & (trials.within < 0.97))
        np.testing.assert_allclose(trials.sd, made.combined, rtol=0.08)
        np.testing.assert_allclose(trials.half_width, made.expanded, rtol=0.08)
        assert np.all(np.abs(trials.shift) < 5 * made.combined / 2000**0.5)


def test_correlated_noise_is_drawn_as_it_is_counted(table1):
    """Means that share slow noise: drawn by the covariance, U holds; drawn independently, biases would be too sure."""
    shared = 1e-8 * (np.eye(24) + 3.0 * np.exp(-np.abs(np.subtract.outer(range(24), range(24))) / 8))
    problem = problem_of(table1, noise_sd=0.1e-3).with_noise(Covariance.by_axis(np.stack([shared] * 3)), known=True)
    made = budget_of(exact.fit(problem), considered(), ENTRIES, "lab.toml")
    trials = monte_carlo(made, 1000, seed=4)
    assert trials.failed == 0 and 0.93 < trials.within.mean() < 0.97
    np.testing.assert_allclose(trials.sd, made.combined, rtol=0.1)
    alone = replace(made, fit=replace(made.fit, problem=problem.independent))
    assert np.any(np.abs(monte_carlo(alone, 1000, seed=4).sd / made.combined - 1) > 0.2)  # the test can fail


def test_budget_on_the_command_line(tumblecal, tmp_path, table1_file):
    lab = tmp_path / "lab.toml"
    lab.write_text('schema = "tumblecal.budget/1"\n[considered]\n' + LAB)
    outcome = tumblecal("budget", table1_file, lab, "--noise-sd", "0.1mg", "--out", tmp_path / "b")
    assert outcome.code == 0 and not outcome.lines, outcome.lines
    content = json.loads((tmp_path / "b" / "budget.json").read_text())
    own = content["parameters"]["dK_y"]
    assert own["u"] == pytest.approx(np.sqrt(own["u_type_a"] ** 2 + sum(u**2 for u in own["contributions"].values())))
    assert own["U"] == pytest.approx(own["k"] * own["u"]) and own["contributions"]["gravity"] == pytest.approx(
        3e-5, rel=1e-3
    )
    assert own["would_reduce_most"]["input"] in {"noise (type A)", *own["contributions"]}
    assert (
        set(content["intrinsic"]) >= {"scale_x", "bias_x", "angle_xy"} and len(content["calibration_covariance"]) == 12
    )
    assert "Largest contribution" in outcome.out and (tmp_path / "b" / "budget.html").exists()


def test_a_gimbal_beside_nist_s_bounds_is_what_the_docs_say(tumblecal, tmp_path, configs):
    """Geist and Gaitan 2022 (PMC11249360): three bounds set the inputs, the other two are not exceeded."""
    outcome = tumblecal("budget", configs / "budget_gimbal.toml", "--out", tmp_path)
    assert outcome.code == 0, outcome.lines
    budget = json.loads((tmp_path / "budget.json").read_text())
    here, page = gimbal.largest_uncertainties(budget), (configs.parent / "docs" / "budget.md").read_text()
    for row in gimbal.table(here):
        assert row in page, row
    for what in ("intrinsic sensitivity", "sensitivity matrix, off-diagonal", "zero-acceleration offset / g"):
        assert here[what] == pytest.approx(gimbal.BOUNDS[what], rel=0.03)
    for what in ("sensitivity matrix, diagonal", "intrinsic angle / rad"):
        assert here[what] < gimbal.BOUNDS[what]


def test_the_noise_of_a_budget_is_that_of_the_calibration(tumblecal, tmp_path, table1):
    """Sd columns a fifth of what the positions scatter: `calibrate` counts with that, and so must its budget; a stated noise
    that is too small is told, as `calibrate` tells it."""
    write_positions(tmp_path / "data.csv", replace(table1, sd=np.full((24, 3), 2e-5)))
    (tmp_path / "lab.toml").write_text(
        'schema = "tumblecal.budget/1"\n[considered.use]\nadds_to = "bias"\nsize = "0.03 mg"\n'
    )
    told = tumblecal("budget", tmp_path / "data.csv", tmp_path / "lab.toml", "-q", "--out", tmp_path).lines
    assert any("the dispersion of the positions exceeds their sd columns" in line for line in told)
    tumblecal("calibrate", tmp_path / "data.csv", "--no-figures", "-q", "--out", tmp_path / "calibration")
    result = json.loads((tmp_path / "calibration" / "result.json").read_text())["methods"]["exact"]["parameters"]
    parameters = json.loads((tmp_path / "budget.json").read_text())["parameters"]
    for name, own in parameters.items():
        assert own["u_type_a"] == pytest.approx(result[name]["sd"], rel=1e-6)
    assert "dispersion of the positions exceeds" in (tmp_path / "budget.html").read_text()
    stated = ("budget", tmp_path / "data.csv", tmp_path / "lab.toml", "--noise-sd", "0.01mg", "--out", tmp_path)
    assert "the residuals exceed the stated noise" in tumblecal(*stated).out
