"""Positions of unknown attitude: only the size of gravity calibrates, as in the nine-parameter fit of the norm."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tumblecal.data import read_positions
from tumblecal.diagnosis import Diagnoser
from tumblecal.diagnosis.detection.detect import weight_of
from tumblecal.diagnosis.detection.null_curve import threshold
from tumblecal.diagnosis.priors import HAND_HELD_SIZE, SIZE
from tumblecal.estimation import exact, problem_of, where_of
from tumblecal.estimation.intrinsic import matrix_and_bias
from tumblecal.estimation.methods import all_methods
from tumblecal.estimation.plausibility import implausible
from tumblecal.ground.errors import InputError


SCALE, BIAS, ANGLES = [4e-3, -3e-3, 6e-3], [0.010, -0.008, 0.03], [1e-3, -4e-3, 2e-3]


def write(path, readings):
    rows = [f"p{k + 1},{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate(readings.tolist())]
    path.write_text("\n".join(["# attitudes: unknown", "position,ax_g,ay_g,az_g", *rows]) + "\n")


def written(path, count, noise):
    rng = np.random.default_rng(8)
    f = Rotation.random(count, random_state=8).apply([0.0, 0.0, 1.0])
    triad = np.array([[1, 0, 0], [ANGLES[0], 1, 0], [ANGLES[1], ANGLES[2], 1]])
    readings = (1 + np.array(SCALE)) * (f @ triad.T) + BIAS + noise * rng.normal(size=(count, 3))
    write(path, readings)
    return readings


def test_it_is_the_fit_of_the_norm(tmp_path):
    readings = written(tmp_path / "hand.csv", 30, 1e-4)
    data = read_positions(tmp_path / "hand.csv")
    result = exact.fit(problem_of(data))
    assert result.dof == 30 - 9 and result.code.good
    matrix, bias, _ = matrix_and_bias(result)

    def off(p):
        lower = np.array([[p[0], 0, 0], [p[1], p[2], 0], [p[3], p[4], p[5]]])
        return np.linalg.norm((readings - p[6:]) @ lower.T, axis=1) - 1

    peer = least_squares(off, [1, 0, 1, 0, 0, 1, 0, 0, 0], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    # Both weigh the norm's error alike, but for the sensor's own small distortion.
    np.testing.assert_allclose(matrix[np.tril_indices(3)], peer[:6], atol=3e-6)
    np.testing.assert_allclose(bias, peer[6:], atol=3e-6)
    np.testing.assert_allclose(bias, BIAS, atol=2e-4)


def test_a_bias_of_a_cheap_sensor_is_plausible(tmp_path):
    """An unknown attitude turns by bias / g: tilts beyond 5 degrees were implausible, and the set rejected."""
    rng, attitudes = np.random.default_rng(2), Rotation.random(24, random_state=8).apply([0.0, 0.0, 1.0])
    for bias, limit in (((0.02, -0.03, 0.1), None), ((0.5, -0.3, 0.4), None), ((0.1, 0.1, 0.9), "bias_z")):
        readings = 1.08 * attitudes + bias + 3e-4 * rng.normal(size=(24, 3))
        write(tmp_path / "hand.csv", readings)
        fit = exact.fit(problem_of(read_positions(tmp_path / "hand.csv")))
        assert np.all(np.abs(fit.values[3:6] - bias) < 5 * fit.sd[3:6])
        assert [own.parameter for own in implausible(fit)] == ([limit] if limit else [])
        # A rig may still limit them.
        assert implausible(fit, {"tilt": np.radians(2.0)})[-1].parameter.startswith("tilt_")


def test_marginal_directions_are_those_of_the_covariance(tmp_path):
    """The weakest direction is the longest axis of the sensor's own block of the covariance."""
    written(tmp_path / "hand.csv", 14, 1e-4)
    fit = exact.fit(problem_of(read_positions(tmp_path / "hand.csv")))
    scales = fit.problem.scales[:9]
    block = fit.covariance[:9, :9] / np.outer(scales, scales)
    own = np.sqrt(np.linalg.eigvalsh(block)) / fit.level
    np.testing.assert_allclose(1.0 / fit.identifiability.singular_values, own, rtol=1e-6)


def test_attitudes_in_one_plane_are_no_calibration(tmp_path):
    rng = np.random.default_rng(3)
    turn = rng.uniform(0, 2 * np.pi, 24)
    f = np.stack([np.cos(turn), np.sin(turn), 0.02 * rng.normal(size=24)], axis=1)
    readings = 1.01 * f / np.linalg.norm(f, axis=1)[:, None] + 0.02 + 1e-4 * rng.normal(size=f.shape)
    write(tmp_path / "flat.csv", readings)
    calibrated = all_methods(problem_of(read_positions(tmp_path / "flat.csv")))
    judged = calibrated.judgements[0]
    assert judged.tone == "bad" and judged.headline.startswith(
        "Usable only in part: these positions determine dK_z poorly (uncertainty "
    )
    use = calibrated.use
    assert use.answer == "only" and "dK_z" not in use.parameters and {"dK_x", "bias_x"} <= {*use.parameters}
    # Out of the plane, to either side of it.
    assert judged.advice.startswith("Measure further attitudes: ") and "+z" in judged.advice and "-z" in judged.advice


def test_a_refusal_for_few_degrees_of_freedom_says_what_to_measure_next(tmp_path):
    written(tmp_path / "hand.csv", 10, 1e-4)
    with pytest.raises(InputError, match=r"leave 1 degree of freedom; .* Next: place it on .*; "):
        Diagnoser(nested=False)(read_positions(tmp_path / "hand.csv"))


def test_sets_of_as_many_positions_share_their_names(tmp_path):
    """A model is made, and compiled, once for all sets with the same names."""
    readings = written(tmp_path / "hand.csv", 12, 1e-4)
    data = read_positions(tmp_path / "hand.csv")
    other = replace(data, beta_deg=np.roll(data.beta_deg, 5), readings=np.roll(readings, 5, axis=0))
    assert where_of(other).labels == where_of(data).labels


def test_few_attitudes_with_unknown_noise_are_diagnosed(tmp_path):
    """Eleven degrees of freedom: sets of causes that explain everything are none; it ended in a traceback."""
    written(tmp_path / "hand.csv", 20, 1e-4)
    diagnosis = Diagnoser(nested=False)(read_positions(tmp_path / "hand.csv"))
    assert diagnosis.verdict == "adequate"
    assert diagnosis.model.not_testable["bias_by_pitch.x"] == "the attitudes are unknown"
    assert "noise_attitude" not in {tried.label for tried in diagnosis.screened.alternatives.noise.listed}


def test_the_test_of_unknown_attitudes_has_a_size_of_its_own(tmp_path):
    written(tmp_path / "hand.csv", 24, 1e-4)
    begun = Diagnoser(nested=False).begun(read_positions(tmp_path / "hand.csv"))
    found, weight = begun.screened.detection, weight_of(begun.screened.pool, begun.screened.alternatives)
    assert found.threshold == threshold(HAND_HELD_SIZE, found.dof, begun.screened.problem.known, weight)
    assert HAND_HELD_SIZE < SIZE
