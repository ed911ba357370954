"""The second blind instrument of benchmarks/ is what its table says; `blind second` is run by hand."""

import numpy as np
import pytest

import in_use_instrument as listed
import second_check as check
import second_head as head
from second_instrument import KINDS, UNLISTED, force_balance


@pytest.mark.parametrize("name", head.PLANS)
def test_frames_are_those_of_the_other_benchmarks(name):
    rng = np.random.default_rng(3)
    plan = head.schedule(name, rng)
    own = head.instrument(plan, rng)
    other = listed.Instrument(own.scale, own.bias, own.gamma, own.mounts, own.turns, own.pitch_errors, {})
    np.testing.assert_allclose(head.readings(own, plan), listed.readings(other, plan), atol=1e-14)


def test_force_balance_by_its_expansion():
    u, per_g, offset, softness = np.linspace(-1, 1, 21), 0.2, 2e-3, 0.01
    second = np.polynomial.Polynomial.fit(u, force_balance(u, per_g, offset, 1e-9, stray=0.0), 5, [-1, 1]).coef[2]
    third = np.polynomial.Polynomial.fit(u, force_balance(u, per_g, 0.0, softness, stray=0.0), 5, [-1, 1]).coef[3]
    assert second == pytest.approx(-offset * per_g, rel=0.01)
    assert third == pytest.approx(per_g**2 * softness, rel=0.06)


def test_stated_truths_describe_their_mechanisms_and_nothing_listed_the_others():
    rng = np.random.default_rng(8)
    plan = head.schedule("4x12 tilted", rng)
    own = head.instrument(plan, rng)
    projector, plain = head.unreachable(own, plan), head.readings(own, plan)
    ids = check.columns(own, plan, projector)
    for name, kind in KINDS.items():
        truth, mechanism = kind(plan, rng)
        signal = projector @ (head.readings(mechanism(own, 1e-3), plan) - plain).ravel()
        if truth in ((), ("noise_coloured",)):
            assert not np.any(signal)
            continue
        signal /= np.linalg.norm(signal)
        if truth == UNLISTED:
            assert min(check.left(signal, basis) for basis in ids.values()) > 0.3, name
        else:
            assert check.left(signal, *(ids[id] for id in truth)) < 0.05, name
