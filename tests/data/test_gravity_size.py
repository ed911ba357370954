"""The size of gravity in readings: wrong scales, an axis without 1 g, and a triad that moved, by all who read positions."""

import sys

import numpy as np
import pytest

from tumblecal.data import PositionSet
from tumblecal.data.gravity_size import gravity_size, moving_fault, size_fault
from tumblecal.ground.frames import gravity_in_head


HEAD = np.asarray(
    gravity_in_head(np.radians(np.tile(np.arange(0.0, 360.0, 45.0), 3)), np.radians(np.repeat([0, 45, 90], 8)))
)
UP = np.vstack([np.eye(3), -np.eye(3)])


def hand_held(count=30, seed=1):
    force = np.random.default_rng(seed).normal(size=(count, 3))
    return force / np.linalg.norm(force, axis=1)[:, None]


def measured(force, bias=(0.05, -0.03, 0.08), seed=2):
    """A triad with usual errors: scale factors up to 5 %, non-orthogonality up to 3 degrees."""
    triad = np.array([[1.05, 0, 0], [0.03, 0.98, 0], [-0.05, 0.02, 1.02]])
    return force @ triad.T + bias + 1e-4 * np.random.default_rng(seed).normal(size=force.shape)


def positions(readings):
    names = tuple(f"p{k}" for k in range(len(readings)))
    angles = np.zeros(len(readings))
    return PositionSet(names, angles, angles, readings, comments={"attitudes": "unknown"}, source="log.csv")


SETS = {"head": HEAD, "hand-held": hand_held(), "six faces": UP}
WRONG = {
    "1 g subtracted from z": (lambda a: a - [0, 0, 1], "1 g was subtracted from axis z", "add 1 g to axis z"),
    "factor 8": (lambda a: 8 * a, "8 times the force, as with a wrong full-scale range", "divide the readings by 8"),
    "0.68 g": (lambda a: 0.68 * a, "a wrong scale", "check the unit and the full-scale range"),
    "counts": (lambda a: 16384 * a, "a wrong scale", "divide them by the counts per g"),
}


@pytest.mark.parametrize("force", SETS.values(), ids=SETS)
@pytest.mark.parametrize(("wrong", "words", "cure"), WRONG.values(), ids=WRONG)
def test_a_wrong_size_is_named_with_a_proposal(force, wrong, words, cure):
    fault = size_fault(wrong(measured(force)))
    assert words in fault and cure in fault and "\n" not in fault


@pytest.mark.parametrize("force", SETS.values(), ids=SETS)
def test_usual_triads_have_the_size_of_gravity(force):
    """Biases up to 0.6 g on an axis, and 0.8 g, which is implausible but no 1 g."""
    for axis in range(3):
        for size in (-0.8, -0.6, -0.3, 0.0, 0.3, 0.6):
            readings = measured(force, bias=size * np.eye(3)[axis])
            assert "1 g was" not in size_fault(readings)
            assert abs(size) > 0.6 or not size_fault(readings)
    for scale in (0.9, 1.1):
        assert not size_fault(scale * measured(force))


def test_positions_of_one_pitch_setting_at_1_g_from_an_axis_are_usual():
    """At a pitch of 30 degrees x is -0.5 g, so the sizes about -1 g on x are equal as well."""
    alpha = np.radians(np.arange(0.0, 360.0, 15.0))
    force = np.asarray(gravity_in_head(alpha, np.full(len(alpha), np.radians(30.0))))
    assert not size_fault(measured(force))


def test_readings_in_one_attitude_have_their_median_size():
    """Their noise has all directions, as attitudes have; zeros have no size."""
    readings = [0.6, 0.0, 0.8] + 5e-4 * np.random.default_rng(1).normal(size=(60, 3))
    assert gravity_size(readings) == pytest.approx(1.0, abs=1e-3) and size_fault(readings) == ""
    assert "a wrong scale" in size_fault(np.zeros((8, 3)))


def test_a_triad_that_moved_is_named_with_the_command_for_recordings(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["tumblecal"])
    rng = np.random.default_rng(3)
    force = hand_held(400)
    fault = moving_fault(positions(measured(force + 0.3 * rng.normal(size=force.shape))))
    assert fault.startswith("the sizes of the readings differ by ") and "the triad was not at rest" in fault
    assert fault.endswith("tumblecal reduce log.csv --static")


@pytest.mark.parametrize("bias", [(0.0, 0.0, 0.0), (0.5, -0.4, 0.5)])
def test_the_dispersion_of_the_sizes_is_that_of_the_force(bias):
    """7 % of the force, whatever the bias of the readings."""
    rng = np.random.default_rng(7)
    force = hand_held(600) * (1 + 0.07 * rng.normal(size=(600, 1)))
    fault = moving_fault(positions(measured(force, bias)))
    assert float(fault.partition("differ by ")[2].partition(" %")[0]) == pytest.approx(7, rel=0.2), fault


def test_means_at_rest_are_not_called_moving():
    """Usual errors, turning at 1 g, gross errors of some readings, and few positions."""
    assert not moving_fault(positions(measured(hand_held(400))))
    readings = measured(hand_held())
    readings[:3] += [[0.5, 0, 0], [0, -0.4, 0], [0, 0, 0.5]]
    readings[3] *= 10
    assert not moving_fault(positions(readings))
    one_axis = measured(hand_held()) * [9.80665, 1, 1]
    assert not moving_fault(positions(one_axis))
    assert not moving_fault(positions(measured(UP) * np.linspace(0.8, 1.2, 6)[:, None]))
