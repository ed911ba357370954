"""Faults of the procedure undone: what was hidden in exact readings is put right, and nothing else is touched."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.diagnosis.causes import exchanged_pairs, faults
from tumblecal.diagnosis.causes.cause import EFFECT, Cause
from tumblecal.diagnosis.causes.faults import mislabel, mislabels, outlier, swap, swaps
from tumblecal.diagnosis.causes.generic import GENERIC, UNEXPLAINED
from tumblecal.diagnosis.causes.plan_steps import plan_steps
from tumblecal.diagnosis.model.tangent import robust_start, tangent
from tumblecal.estimation import exact, problem_of


@pytest.fixture(scope="module")
def problem():
    """Readings without noise."""
    setup = blind.random_setup(np.random.default_rng(3), 3, 8)
    return problem_of(position_set(setup, blind.readings(setup, setup.nominal, {}), known=True))


def moved(problem, position, stood):
    """A mislabel of one position that stood where `stood` has it."""
    return mislabel(f"mislabelled_angle:{problem.names[position]}", (0.0, 0.0), None, position, "", stood)


def test_a_swap_undone_twice_is_the_swap(problem):
    exchange = swap("swapped_positions:a+b", (0.0, 0.0), None, (3, 10))
    swapped = exchange.undone(problem)
    np.testing.assert_array_equal(swapped.readings[[3, 10]], problem.readings[[10, 3]])
    others = np.setdiff1d(np.arange(24), [3, 10])
    np.testing.assert_array_equal(swapped.readings[others], problem.readings[others])
    right = exchange.undone(swapped)
    np.testing.assert_array_equal(right.readings, problem.readings)
    assert right.where is problem.where and right.retained is None
    assert exact.fit(swapped).rms > 1e-3 and exact.fit(right).rms < 1e-12


def test_an_outlier_undone_is_left_out_and_nothing_else(problem):
    readings = np.array(problem.readings)
    readings[7] += [8e-3, -6e-3, 7e-3]
    knocked = replace(problem, readings=readings)
    knock = outlier("outlier_position:a", (0.0, 0.0), None, 7)
    right = knock.undone(knocked)
    assert np.flatnonzero(~right.takes_part).tolist() == [7] == list(knock.left_out)
    assert right.readings is readings and right.where is problem.where
    np.testing.assert_array_equal(knock.undone(right).takes_part, right.takes_part)
    assert exact.fit(knocked).rms > 1e-3 and exact.fit(right).rms < 1e-12
    np.testing.assert_allclose(exact.fit(right).residuals[7], [8e-3, -6e-3, 7e-3], atol=1e-11)


@pytest.mark.parametrize(
    ("there", "back"),
    [
        ("next spindle angle", "previous spindle angle"),
        ("previous spindle angle", "next spindle angle"),
        ("next pitch setting", "previous pitch setting"),
        ("previous pitch setting", "next pitch setting"),
    ],
)
def test_a_mislabelled_angle_goes_there_and_back(problem, there, back):
    options = {step.words: (step.of(problem.where), step.valid) for step in plan_steps(problem.where)}
    assert set(options) == {
        f"{way} {what}" for way in ("next", "previous") for what in ("spindle angle", "pitch setting")
    }
    stood, valid = options[there]
    assert np.sum(valid) == (24 if "spindle" in there else 16)
    for position in np.flatnonzero(valid).tolist():
        wrong = moved(problem, position, stood).undone(problem)
        changed = "alpha" if "spindle" in there else "beta"
        angles = getattr(wrong.where, changed), getattr(problem.where, changed)
        assert np.flatnonzero(angles[0] != angles[1]).tolist() == [position]
        assert wrong.readings is problem.readings
        returned = next(step.of(wrong.where) for step in plan_steps(wrong.where) if step.words == back)
        right = moved(wrong, position, returned).undone(wrong)
        # Steps of the spindle are told apart, and taken, to 1e-9 rad.
        np.testing.assert_allclose(right.where.alpha, problem.where.alpha, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(right.where.beta, problem.where.beta)
        for name, index in problem.where.groups.items():
            np.testing.assert_array_equal(right.where.groups[name], index)
    assert exact.fit(wrong).rms > 1e-4 and exact.fit(right).rms < 1e-9


def test_what_is_fitted_leaves_the_problem_alone(problem):
    effect = Cause(EFFECT, "second_order.y", 0.0, 0.0, np.ones((4, 1)), directions=np.ones((1, 1)))
    term = Cause(GENERIC, UNEXPLAINED, 0.0, 0.0, np.ones((4, 1)), terms=(np.ones(72),), words="time^2")
    assert effect.undone(problem) is problem and term.undone(problem) is problem
    assert effect.named and not term.named


def test_no_fault_is_left_out_that_could_explain_anything(diagnoser, hidden, monkeypatch):
    """What is left out for its size leaves more than there is when it is undone; two positions exchanged are not left out."""

    def exchanged(readings, rng):
        readings[[3, 10]] = readings[[10, 3]]
        return readings

    def offsets(at):
        return {
            offset.tobytes(): label for table in (swaps(at, 1.0), mislabels(at, 1.0)) for label, offset in listed(table)
        }

    def listed(table):
        return zip(table.labels, table.rows, strict=True)

    for change in (None, exchanged):
        screened = diagnoser(hidden(61, {"second_order.y": [8e-4]}, change=change)).screened
        at = tangent(screened.at.model, screened.problem, robust_start(screened.at.model, screened.problem))
        tried = offsets(at)
        with monkeypatch.context() as patched:
            patched.setattr(faults, "FAR", 1e9)
            every = offsets(at)
        left_out = [np.frombuffer(offset) for offset in every.keys() - tried.keys()]
        assert all(np.linalg.norm(at.z - offset) > np.linalg.norm(at.z) for offset in left_out)
        swap = f"swapped_positions:{screened.problem.names[3]}+{screened.problem.names[10]}"
        assert len(left_out) > 200 if change is None else swap in tried.values()


@pytest.mark.parametrize(("known", "effects"), [(True, {"index_eccentricity": [2e-3, -1e-3]})])
def test_of_many_positions_any_two_that_were_exchanged(diagnoser, known, effects, monkeypatch):
    """Rows more than 34 apart were no candidates: two positions off were named. 48 positions count as many here."""
    monkeypatch.setattr(exchanged_pairs, "MOST_PAIRS", 500)
    rng = np.random.default_rng(17)
    setup = blind.random_setup(rng, 4, 12)
    readings = blind.readings(setup, setup.nominal, effects)
    readings += blind.SIGMA * rng.normal(size=readings.shape)
    readings[[5, 43]] = readings[[43, 5]]
    diagnosis = diagnoser(position_set(setup, readings, known))
    assert set(diagnosis.best.labels) == {f"swapped_positions:{setup.names[5]}+{setup.names[43]}", *effects}
    assert diagnosis.verdict == "identified"


def test_what_undoing_an_exchange_leaves(hidden, diagnoser, monkeypatch):
    """Of many positions those pairs are candidates that leave least of what the nominal model leaves."""
    screened = diagnoser(hidden(62, {"second_order.y": [8e-4]})).screened
    at, swap = screened.at, faults.swaps(screened.at, 1.0)
    left = np.linalg.norm(at.z - swap.rows, axis=1)
    monkeypatch.setattr(exchanged_pairs, "MOST_PAIRS", 10)
    monkeypatch.setattr(exchanged_pairs, "PAIRS_OF_MANY", 40)
    fewer = faults.swaps(at, 1.0)
    assert {*fewer.labels} == {swap.labels[k] for k in np.argsort(left)[:40]}
    np.testing.assert_allclose(fewer.log_weights, swap.log_weights[0])
