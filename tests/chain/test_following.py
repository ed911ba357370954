"""Leaves that follow temperature, against the independent chain with polynomials and splines written out."""

import numpy as np
import pytest

import independent
from independent import Instrument
from tumblecal import InputError, Problem, fit
from tumblecal.chain import followings_of, hand_held_chain, nominal_chain, settings
from tumblecal.chain.plan import grid
from tumblecal.ground.temperature_functions import TemperatureFunctions


SOAKS = (0.0, 15.0, 28.0, 41.0, 60.0)
RANGE = (0.0, 60.0)
REFERENCE = 25.0
PLAN = grid(np.arange(8) * 45.0, [0.0, 45.0, 90.0])
ALPHA, BETA = (np.tile(angles, len(SOAKS)) for angles in (PLAN.alpha, PLAN.beta))
SETTING = np.tile(np.repeat([0, 1, 2], 8), len(SOAKS))
DEGC = np.repeat(SOAKS, 24) + np.tile(np.linspace(-0.2, 0.2, 24), len(SOAKS))
WHERE = settings(ALPHA, BETA, temperature_degc=DEGC)
NOISE = 1e-4
# Physical coefficients (order, axis), base units per degC^k: a cubic bias, a linear scale, a quadratic non-orthogonality.
CUBIC_BIAS = np.array([[2e-4, -1e-4, 5e-5], [-3e-6, 2e-6, 4e-6], [6e-8, -5e-8, 2e-8]])
LINEAR_SCALE = np.array([[3e-5, -2e-5, 1e-5]])
QUADRATIC_GAMMA = np.array([[5e-6, -4e-6, 3e-6], [2e-7, 1e-7, -2e-7]])
AT_REFERENCE = {
    "dK": np.array([1e-3, -2e-3, 5e-4]),
    "bias": np.array([2e-3, -1e-3, 3e-3]),
    "dtheta": np.array([1e-3, 2e-3, -1e-3]),
    "gamma": np.array([-5e-4, 3e-4, 1e-3]),
    "dbeta": np.array([2e-4, -3e-4, 1e-4]),
}
PHYSICAL = {"bias": CUBIC_BIAS, "dK": LINEAR_SCALE, "gamma": QUADRATIC_GAMMA}
FUNCTIONS = {leaf: TemperatureFunctions(len(rows), REFERENCE, RANGE) for leaf, rows in PHYSICAL.items()}


def changed(leaf: str, degc: np.ndarray) -> np.ndarray:
    """The leaf at temperatures (rows, 3), by its polynomial."""
    powers = np.stack([(degc - REFERENCE) ** (k + 1) for k in range(len(PHYSICAL[leaf]))], axis=-1)
    return AT_REFERENCE[leaf] + powers @ PHYSICAL[leaf]


def readings() -> np.ndarray:
    """(positions, 3), g: the force in the triad's frame, then its matrix and bias at each temperature."""
    ideal = Instrument(np.zeros(3), np.zeros(3), AT_REFERENCE["dtheta"], np.zeros(3), AT_REFERENCE["dbeta"][SETTING])
    force = independent.readings(ALPHA, BETA, ideal)
    g21, g31, g32 = changed("gamma", DEGC).T
    inputs = np.stack(
        [force[:, 0], force[:, 1] + g21 * force[:, 0], force[:, 2] + g31 * force[:, 0] + g32 * force[:, 1]], axis=1
    )
    return (1 + changed("dK", DEGC)) * inputs + changed("bias", DEGC)


@pytest.fixture(scope="module")
def problem() -> Problem:
    chain = nominal_chain(WHERE, temperature=FUNCTIONS)
    noise = NOISE * np.random.default_rng(47).standard_normal((len(DEGC), 3))
    return Problem.from_arrays(chain, WHERE, readings() + noise, noise_sd=NOISE)


def truth(chain) -> np.ndarray:
    """The true vector of the chain, orthonormal combinations included."""
    values = {}
    for leaf in chain.free:
        name = leaf.name.removesuffix("_T")
        rows = FUNCTIONS[name].of_coefficients(PHYSICAL[name]) if leaf.name.endswith("_T") else AT_REFERENCE[name]
        values |= dict(zip(leaf.names, np.ravel(rows), strict=True))
    return np.array([values[name] for name in chain.names])


def test_the_chain_equals_the_independent_one(problem):
    chain = problem.chain.at(truth(problem.chain))
    np.testing.assert_allclose(np.asarray(chain(WHERE)), readings(), rtol=0, atol=1e-14)


def test_a_fit_recovers_the_parameters_within_their_uncertainty(problem):
    result = fit(problem)
    deviation = result.values - truth(problem.chain)
    count = len(deviation)
    chi2 = deviation @ np.linalg.solve(result.covariance, deviation)
    assert result.code.good and abs(chi2 - count) < 4 * np.sqrt(2 * count)
    assert np.all(np.abs(deviation) < 4 * result.sd)


def test_what_cannot_follow_temperature_is_refused():
    with pytest.raises(InputError, match="gamma follows temperature, but the data have no column temperature_degc"):
        nominal_chain(WHERE, temperature=FUNCTIONS)(settings(ALPHA, BETA))
    with pytest.raises(InputError, match="no leaf scale that could follow temperature"):
        nominal_chain(WHERE, temperature={"scale": TemperatureFunctions(1, 0.0, RANGE)})
    with pytest.raises(InputError, match="tilt has a value for each position"):
        hand_held_chain(WHERE, temperature={"tilt": TemperatureFunctions(1, 0.0, RANGE)})


def test_every_leaf_may_follow_a_spline_and_runs_share_its_change():
    knots = (20.0, 40.0)
    functions = TemperatureFunctions(3, REFERENCE, RANGE, knots)
    run = ["a"] * 60 + ["b"] * 60
    where = settings(ALPHA, BETA, run=run, temperature_degc=DEGC)
    plain = nominal_chain(where, bias_by="run")
    powers = [(DEGC - REFERENCE) ** k for k in (1, 2, 3)]
    cubes = [np.maximum(DEGC - knot, 0) ** 3 - np.maximum(REFERENCE - knot, 0) ** 3 for knot in knots]
    rng = np.random.default_rng(3)
    for leaf in ("bias", "dK", "gamma", "dtheta", "dbeta"):
        chain = nominal_chain(where, bias_by="run", temperature={leaf: functions})
        change = next(found.change for found in followings_of(chain))
        width = 1 if leaf == "dbeta" else 3
        physical = rng.normal(0, 1e-3, (5, width)) / np.array([60, 60**2, 60**3, 60**3, 60**3])[:, None]
        start = rng.normal(0, 1e-3, len(plain.names))
        values = dict(zip(plain.names, start, strict=True))
        values |= dict(zip(change.names, functions.of_coefficients(physical).ravel(), strict=True))
        row = 100  # of run b
        moved = dict(zip(plain.names, start, strict=True))
        names = [name for name in plain.names if name.startswith(leaf) and "@run=a" not in name]
        names = names if leaf != "dbeta" else [f"dbeta_{SETTING[row]}"]
        for name, amount in zip(names, np.array([*powers, *cubes]).T[row] @ physical, strict=True):
            moved[name] += amount
        np.testing.assert_allclose(chain.named(values)(where)[row], plain.named(moved)(where)[row], rtol=0, atol=1e-14)


def test_a_single_attitude_names_the_combination_of_bias_and_scale_over_temperature():
    degc = np.linspace(0.0, 60.0, 30)
    where = settings(np.zeros(30), np.zeros(30), temperature_degc=degc)
    linear = TemperatureFunctions(1, REFERENCE, RANGE)
    chain = nominal_chain(where, temperature={"bias": linear, "dK": linear})
    chain = chain.fixed({"dK", "dtheta", "gamma", "dbeta"})
    problem = Problem.from_arrays(chain, where, np.asarray(chain(where)), noise_sd=NOISE)
    with pytest.raises(InputError) as raised:
        fit(problem)
    text = str(raised.value)
    assert "dK_T_z1 - bias_T_z1" in text and "(bias_T and dK_T: bias and dK over temperature)" in text
    assert "Lower the order of bias and dK in [temperature]" in text
