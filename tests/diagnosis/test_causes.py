"""Faults of the procedure undone: what was hidden in exact readings is put right, and nothing else is touched."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.diagnosis.causes.cause import Cause, Kind
from tumblecal.diagnosis.causes.faults import mislabel, outlier, plan_steps, swap
from tumblecal.diagnosis.causes.table import Pool
from tumblecal.diagnosis.causes.terms import jumps
from tumblecal.estimation import exact, problem_of


@pytest.fixture(scope="module")
def problem():
    """Readings without noise."""
    setup = blind.random_setup(np.random.default_rng(3), 3, 8)
    return problem_of(position_set(setup, blind.readings(setup, setup.nominal, {}), known=True))


def moved(problem, position, stood):
    """A mislabel of one position that stood where `stood` has it."""
    return mislabel(position, "", stood, Cause(Kind.MISLABEL, "", 0.0, 0.0))


def test_a_swap_undone_twice_is_the_swap(problem):
    exchange = swap((3, 10), Cause(Kind.SWAP, "", 0.0, 0.0))
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
    knock = outlier(7, Cause(Kind.OUTLIER, "", 0.0, 0.0))
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
        ("previous pitch setting", "next pitch setting"),
    ],
)
def test_a_mislabelled_angle_goes_there_and_back(problem, there, back):
    options = {words: (moved, valid) for words, moved, valid in plan_steps(problem.where)}
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
        returned = next(where for words, where, _ in plan_steps(wrong.where) if words == back)
        right = moved(wrong, position, returned).undone(wrong)
        # Steps of the spindle are told apart, and taken, to 1e-9 rad.
        np.testing.assert_allclose(right.where.alpha, problem.where.alpha, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(right.where.beta, problem.where.beta)
        for name, index in problem.where.groups.items():
            np.testing.assert_array_equal(right.where.groups[name], index)
    assert exact.fit(wrong).rms > 1e-4 and exact.fit(right).rms < 1e-9


def test_signals_of_jumps_are_those_of_the_blind_instrument(hidden, diagnoser):
    """By central differences at the truth; the candidates are made at the fit, which differs by some tenths of a mrad."""
    at = diagnoser(hidden(2, {})).screened.at
    setup = blind.random_setup(np.random.default_rng(2), 3, 8)
    every = Pool.joined(jumps(at), at.dof)
    own = [k for k, label in enumerate(every.labels) if label.endswith(f":{setup.names[12]}")]
    candidates = [every.causes[k] for k in own]
    assert [cause.words for cause in candidates if cause.words] == ["x axis", "y axis", "z axis"]
    for cause in candidates:
        effect = "?mount_slip" if cause.label.startswith("mount") else f"?step_half_way.{cause.words[0]}"
        for signal, unit in zip(cause.terms, np.eye(len(cause.terms)) * 1e-5, strict=True):
            there, back = (blind.readings(setup, setup.nominal, {effect: sign * unit}) for sign in (1, -1))
            expected = ((there - back) / 2e-5).ravel() / blind.SIGMA
            scale = at.model.scales[0] if effect == "?mount_slip" else 1.0
            np.testing.assert_allclose(signal / scale, expected, atol=1e-3 / blind.SIGMA)
            # The block spans what is left of them.
            rest = at.basis[: len(signal)].T @ signal
            assert np.linalg.norm(rest - cause.block @ (cause.block.T @ rest)) < 1e-9 * np.linalg.norm(rest)
