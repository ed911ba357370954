"""One thing hidden, and the class of explanations that must be stated: no name that the data do not decide, none left out."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_sets import classes, measured, of_size
from tumblecal.data import PositionSet
from tumblecal.diagnosis.sets.explanation import Explanation, verdict_of
from tumblecal.lab.extended_rig import extended_rig_text


def added(data: PositionSet, rows, change) -> PositionSet:
    """The readings of these rows with something added."""
    return replace(data, readings=data.readings + np.asarray(rows)[:, None] * np.array(change))


@pytest.mark.long
def test_along_the_spindle_bias_and_scale_factor_by_setting_are_one_class(hidden, diagnoser):
    """The input of x is the same all through a setting; around the exact fit of the one the other had fewer directions."""
    name, setup = "scale_by_pitch.x", blind.random_setup(np.random.default_rng(1), 4, 12)
    diagnosis = diagnoser(hidden(1, {name: of_size(setup, name, [-0.05, -0.6, 0.75], 100)}, plan=(4, 12)))
    assert {("bias_by_pitch.x",), (name,)} <= classes(diagnosis) and diagnosis.verdict == "ambiguous"


@pytest.mark.parametrize("by_setting", [False, True])
def test_what_jumps_with_a_change_of_setting_may_be_another_bias_by_setting(hidden, diagnoser, by_setting):
    """Of 3 x 8 positions: a jump at the first of a setting is a bias by setting of two values; both are hidden, and are one."""
    name, begins = "bias_by_pitch.y", 8
    data = hidden(5, {name: [3e-3, 3e-3]} if by_setting else {})
    data = data if by_setting else added(data, np.arange(24) >= begins, [0.0, 3e-3, 0.0])
    diagnosis = diagnoser(data)
    assert diagnosis.verdict == "ambiguous" and {(f"bias_jump:{data.names[begins]}",), (name,)} <= classes(diagnosis)
    # Of the further axes of the family none is needed.
    assert not any(len(labels) > 1 and name in labels for labels in classes(diagnosis))


@pytest.mark.parametrize(("seed", "setting"), [(1, 1), pytest.param(2, 0, marks=pytest.mark.long)])
def test_a_fixture_that_moves_at_one_pitch_setting(hidden, diagnoser, seed, setting):
    """The angles of the mount at one of three settings: it was an index_zero, a slip or unexplained. At the first and the last
    setting it may as well have slipped when the setting was changed."""
    setup = blind.random_setup(np.random.default_rng(seed), 3, 8)
    moved = replace(setup, pitch=np.where(setup.pitch == setting, 0, 1))
    nominal, angles = {**setup.nominal, "dbeta": np.zeros(2)}, np.array([0.4e-3, -0.3e-3, 0.5e-3])
    change = blind.readings(moved, nominal, {"mount_by_pitch": angles}) - blind.readings(moved, nominal, {})
    diagnosis = diagnoser(hidden(seed, {}, change=lambda readings, rng: readings + change))
    assert ("mount_by_pitch",) in classes(diagnosis)
    if setting == 1:
        assert diagnosis.labels == ("mount_by_pitch",) and diagnosis.verdict == "identified"
        assert diagnosis.members[0].slot.names == ("mount_by_pitch_x_1", "mount_by_pitch_y_1", "mount_by_pitch_z_1")
        assert not extended_rig_text(diagnosis)  # there it would move at the first setting
    else:
        assert diagnosis.verdict == "ambiguous"
        assert any(labels[0].startswith("mount_slip") for labels in classes(diagnosis))


def test_no_scale_factor_that_no_sensor_has_explains_a_bias_where_the_input_is_near_zero(hidden, diagnoser):
    """An offset of y at beta 90, where its input is some mg: a scale factor beyond 0.1 g/g there was in the class."""
    there = blind.random_setup(np.random.default_rng(1), 3, 8).pitch == 2
    diagnosis = diagnoser(added(hidden(1, {}), there, [0.0, 1.5e-3, 0.0]))
    assert ("bias_by_pitch.y",) in classes(diagnosis)
    assert not any("scale_by_pitch.y" in labels for labels in classes(diagnosis))


@pytest.mark.long
@pytest.mark.parametrize("id", ["warm_up", "bias_drift.y"])
def test_runs_with_a_clock_each(diagnoser, id):
    """A warm-up in every run was `unexplained`, its times taken as going on; a drift goes on from run to run."""
    rng = np.random.default_rng(31)
    setup = blind.random_setup(rng, 3, 8)
    time, run = setup.time_s - setup.time_s[0], np.repeat([1, 2], 24)
    twice = ("alpha", "beta", "temperature_degc", "approach", "pitch")
    setup = replace(
        setup,
        **{name: np.tile(getattr(setup, name), 2) for name in twice},
        time_s=np.tile(time, 2),
        names=[f"{part}-{name}" for part in "ab" for name in setup.names],
    )
    going_on = replace(setup, time_s=setup.time_s + run * (time[-1] + 60.0))
    there, effects = (setup, {id: [2e-3, -1.5e-3, 1e-3, 400.0]}) if id == "warm_up" else (going_on, {id: [4e-7]})
    data = replace(
        measured(there, effects, rng), time_s=setup.time_s, run=tuple(str(number) for number in run.tolist())
    )
    diagnosis = diagnoser(data)
    assert (id,) in classes(diagnosis) and diagnosis.verdict == "identified"
    assert not diagnosis.setup_errors  # runs that have a clock each are no slip


def test_a_listed_set_that_leads_in_the_place_of_a_larger_one_without_a_name_is_not_claimed():
    square, more = ("second_order.x",), ("second_order.x", "unexplained")
    for own, other in ((0.15, 0.8), (0.9, 0.08)):
        led = Explanation(square, (more,), own, (other,), (3,), at_any_odds=(more,))
        assert led.separable == (more,) and led.probability == own + other
        assert verdict_of(led, False, False, False) == "ambiguous"
    assert Explanation(more, (square,), 0.8, (0.15,), (3, 9)).separable == ()
