"""Positions set by hand: their tilts are estimated with the noise, and readings along gravity have their full weight."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.chain import nominal_chain
from tumblecal.data import PositionSet
from tumblecal.data.calibration import read_calibration
from tumblecal.estimation import problem_of, where_of
from tumblecal.estimation.attitude_scatter import LEAST_ODDS, TILT, AttitudeScatter, Size, _posterior, _Rows
from tumblecal.estimation.methods import all_methods, exact_fit


FACES = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)
NAMES = ("x_up", "x_down", "y_up", "y_down", "z_up", "z_down")
EDGES = np.array([(0, 1, 1), (0, -1, -1), (1, 0, 1), (-1, 0, -1), (1, 1, 0), (-1, -1, 0)]) / np.sqrt(2)


def turned(rng, sd):
    """A rotation by a random angle (rad) about each axis; numpy only."""
    x, y, z = rng.normal(0.0, sd, 3)
    skew = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    size = max(np.sqrt(x * x + y * y + z * z), 1e-12)
    return np.eye(3) + np.sin(size) / size * skew + (1 - np.cos(size)) / size**2 * skew @ skew


def cube(seed, tilt_deg, noise_g, up=FACES):
    """A cube that was set by hand at nominal angles, and its true dK, bias, gamma."""
    rng = np.random.default_rng(seed)
    scale, bias, gamma = rng.normal(0, 2e-3, 3), rng.normal(0, 5e-3, 3), rng.normal(0, 3e-3, 3)
    axes = np.array([[1, 0, 0], [gamma[0], 1, 0], [gamma[1], gamma[2], 1]]) @ turned(rng, np.radians(0.5))
    force = np.array([turned(rng, np.radians(tilt_deg)) @ direction for direction in up])
    readings = force @ axes.T * (1 + scale) + bias + rng.normal(0, noise_g, up.shape)
    alpha, beta = np.degrees(np.arctan2(up[:, 1], up[:, 2])), np.degrees(np.arcsin(-up[:, 0]))
    names = NAMES if len(up) == 6 else tuple(f"p{number}" for number in range(len(up)))
    data = PositionSet(names, np.round(alpha, 9), np.round(beta, 9), readings, source="cube.csv")
    return data, np.concatenate([scale, bias, gamma])


def fitted(data, noise_sd=None, stated=None):
    """As in `calibrate --fix dbeta`."""
    data = replace(data, comments={} if stated is None else {"attitudes": stated})
    chain = nominal_chain(where_of(data)).fixed({"dbeta"})
    return exact_fit(problem_of(data, chain, noise_sd=noise_sd), by_columns=False)


def test_six_faces_give_the_bias_as_pairs_of_faces_do_with_intervals_that_hold():
    """40 cubes at 0.5 deg and 0.1 mg. As equal noise the rms error is 2.6 mg."""
    errors, halves, of_pairs = [], [], []
    for seed in range(40):
        data, truth = cube(seed, 0.5, 1e-4)
        found = fitted(data, 1e-4)
        assert found.scatter is not None and 0.2 < np.degrees(found.scatter.tilt_rad) < 1.0
        here = [found.fit.names.index(f"{leaf}_{axis}") for leaf in ("dK", "bias") for axis in "xyz"]
        errors.append(found.fit.values[here] - truth[:6])
        halves.append(np.ptp(found.fit.interval(0.95), axis=1)[here] / 2)
        of_pairs.append(np.diag(data.readings[::2] + data.readings[1::2]) / 2 - truth[3:6])
    rms_pairs, rms = np.sqrt(np.mean(np.square(of_pairs))), np.sqrt(np.mean(np.square(errors), axis=0))
    assert rms_pairs < 0.15e-3 and np.all(rms < 1.7 * rms_pairs)
    # Binomial: 0.95 of 240, less than 0.90 with a probability of 0.001.
    assert np.mean(np.abs(errors) <= np.array(halves)) >= 0.90
    # They are no wider than the error needs.
    assert np.median(halves) < 0.4e-3


def test_a_dividing_head_does_not_get_tilts():
    """24 positions with angle errors of 0.02 deg at noise of 0.1 mg, and none at 0.1 and 1 mg: 5 sets of each."""
    alpha, beta = np.tile(np.arange(8) * 45.0, 3), np.repeat([0.0, 45.0, 90.0], 8)
    a, b = np.radians(alpha), np.radians(beta)
    up = np.stack([-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)], axis=1)
    for error_deg, noise_g in ((0.02, 1e-4), (0.0, 1e-4), (0.0, 1e-3)):
        for seed in range(5):
            rng = np.random.default_rng(seed)
            force = np.array([turned(rng, np.radians(error_deg)) @ direction for direction in up])
            readings = force + rng.normal(0, noise_g, up.shape)
            data = PositionSet(tuple(f"p{k}" for k in range(24)), alpha, beta, readings, source="head.csv")
            for noise_sd in (noise_g, None):
                assert exact_fit(problem_of(data, noise_sd=noise_sd), by_columns=False).scatter is None


def test_noise_that_the_positions_do_not_show_is_assumed_and_said_so():
    """Six faces: along gravity there are as many readings as parameters."""
    data, truth = cube(3, 0.5, 1e-4)
    calibrated = all_methods(problem_of(data, nominal_chain(where_of(data)).fixed({"dbeta"})))
    scatter, fit = calibrated.scatter, calibrated.exact
    assert scatter is not None and not scatter.noise_determined and "state it (--noise-sd)" in scatter.words
    assert scatter.log_odds >= LEAST_ODDS and "--attitudes head" in scatter.words
    bias = [fit.names.index(f"bias_{axis}") for axis in "xyz"]
    np.testing.assert_allclose(fit.values[bias], truth[3:6], atol=0.4e-3)
    assert 0.3e-3 < np.max(fit.sd[bias]) < 1.5e-3
    assert calibrated.use.answer == "not tested" and "harmonic" in calibrated.skipped


@pytest.mark.long
@pytest.mark.usefixtures("few_effects")
def test_diagnose_names_tilts_rather_than_outlier_positions(tumblecal, tmp_path):
    """Without tilts two outlier positions are the most probable cause here."""
    readings = """1.004186,0.002788,0.003451 -0.996339,0.002972,0.008447 -0.001382,1.000639,0.001907
        0.001836,-0.999781,-0.005778 0.001594,-0.011383,0.999790 -0.001226,-0.005663,-1.003565"""
    angles = ("0,-90", "0,90", "90,0", "-90,0", "0,0", "180,0")
    rows = [",".join(row) for row in zip(NAMES, angles, readings.split(), strict=True)]
    (tmp_path / "six.csv").write_text("\n".join(["position,alpha_deg,beta_deg,ax_g,ay_g,az_g", *rows, ""]))
    given = ("diagnose", tmp_path / "six.csv", "--fix", "dbeta", "--noise-sd", "0.1mg", "--no-figures")
    outcome = tumblecal(*given, "--out", tmp_path / "dia")
    assert "the attitude scatters by 9.2 mrad (0.53 deg)" in " ".join(outcome.out.split())
    found = read_calibration(tmp_path / "dia/calibration.json")
    np.testing.assert_allclose(found.bias, [4.0e-3, 0.4e-3, -1.9e-3], atol=0.15e-3)
    assert np.all(np.sqrt(np.diag(found.covariance)[9:]) < 0.2e-3) and found.use.answer == "not tested"
    assert found.provenance["attitudes"] == "hand"


def test_a_posterior_is_the_integral_over_both_sizes():
    """Against the sum over a fine grid; noise alone in closed form at a known size."""
    rng = np.random.default_rng(4)
    rows = _Rows(rng.normal(0, 3.0, 30), rng.normal(0, 1, (30, 4)), np.repeat([0.0, 1e6, 1e6], 10), 30)
    noise = Size(1.0, 0.7)
    x, y = np.linspace(-6, 6, 241), np.log(TILT.median) + np.linspace(-9, 9, 361)
    sizes = np.exp(np.stack([grid.ravel() for grid in np.meshgrid(x, y, indexing="ij")]))
    density = rows.log_likelihood(*sizes)
    for size, prior in zip(sizes, (noise, TILT), strict=True):
        density += -0.5 * (np.log(size / prior.median) / prior.spread) ** 2 - np.log(prior.spread * np.sqrt(2 * np.pi))
    weights = np.exp(density - density.max())
    expected = density.max() + np.log(weights.sum() * (x[1] - x[0]) * (y[1] - y[0]))
    found = _posterior(rows, noise, TILT)
    assert found.log_evidence == pytest.approx(expected, abs=0.02)
    assert (found.noise, found.tilt) == pytest.approx(tuple(np.sqrt(sizes**2 @ weights / weights.sum())), rel=0.02)
    alone = _posterior(rows, Size(2.0, 0.0), Size(0.0, 0.0))
    residual = rows.residual - rows.design @ np.linalg.lstsq(rows.design, rows.residual, rcond=None)[0]
    log_det = np.linalg.slogdet(rows.design.T @ rows.design / 4)[1]
    assert alone.log_evidence == pytest.approx(-30 * np.log(2.0) - 0.5 * log_det - residual @ residual / 8)


def test_tilts_have_the_covariance_of_the_priors_of_a_rig():
    """A prior of several correlated parameters is a matrix: the tilts add their rows."""
    data, _ = cube(5, 0.5, 1e-4, np.vstack([FACES, EDGES]))
    chain, covariance = nominal_chain(where_of(data)).fixed({"dbeta"}), 1e-6 * np.array([[1.0, 0.5], [0.5, 1.0]])
    problem = problem_of(data, chain, noise_sd=1e-4, priors={("dK_x", "dK_y"): (np.zeros(2), covariance)})
    tilted = AttitudeScatter(1e-2, 1.0, 1e-4, 9.0, True).applied(problem)
    root, names = tilted.prior_root, tilted.chain.names
    own = [names.index(name) for name in ("dK_x", "dK_y")]
    np.testing.assert_allclose(np.linalg.inv((root.T @ root)[np.ix_(own, own)]), covariance)
    tilts = [k for k, name in enumerate(names) if name.startswith("tilt")]
    np.testing.assert_allclose((root.T @ root)[np.ix_(tilts, tilts)], 1e4 * np.eye(24))
