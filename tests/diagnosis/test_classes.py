"""Causes that make the same signal on a plan are one class, whatever their priors, with or without a name."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from tumblecal.diagnosis.sets.classes import named_in_place
from tumblecal.diagnosis.sets.explanation import Explanation, verdict_of
from tumblecal.diagnosis.sets.patchwork import is_patchwork
from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis
from tumblecal.report.rig_files import extended_rig_text


def of_size(plan, seed, name, direction, d):
    """Coefficients whose part that the nominal model cannot reach has norm d sigma, for the instrument of `hidden`."""
    setup = blind.random_setup(np.random.default_rng(seed), *plan)
    plain = blind.readings(setup, setup.nominal, {})
    unit = np.asarray(direction) * 1e-6
    signal = blind.unreachable(setup) @ (blind.readings(setup, setup.nominal, {name: unit}) - plain).ravel()
    return unit * d * blind.SIGMA / np.linalg.norm(signal)


def told(diagnosis):
    return {diagnosis.best.labels, *diagnosis.best.equivalents}


def test_a_gain_that_steps_between_settings_is_not_identified_as_scale_by_pitch(hidden, diagnoser):
    """Half-way through 4 x 12 positions the pitch setting changes; the generic step was no candidate beside the entry."""
    for seed, axis in ((1, "y"), (2, "z"), (4, "y")):
        name = f"?gain_step_half_way.{axis}"
        data = hidden(seed, {name: of_size((4, 12), seed, name, [1.0], 10)}, plan=(4, 12))
        diagnosis = diagnoser(data)
        assert {("unexplained",), (f"scale_by_pitch.{axis}",)} <= told(diagnosis)
        assert diagnosis.verdict == "ambiguous"


def test_a_scale_factor_by_setting_is_in_the_class_of_a_product_of_inputs(hidden, diagnoser):
    """On 3 x 8 positions they differ by prior and number of coefficients alone."""
    for seed, axis in ((1, "y"), (2, "z"), (3, "y")):
        name = f"scale_by_pitch.{axis}"
        sizes = of_size((3, 8), seed, name, [1.0, 0.1], 10)
        classes = told(diagnoser(hidden(seed, {name: sizes}, sd=seed != 3)))
        assert {(name,), ("cross_coupling.y.xy",), ("cross_coupling.z.xz",)} <= classes


@pytest.mark.parametrize(("begins", "verdict"), [((17,), "identified"), ((7, 19, 31), "ambiguous")])
def test_one_jump_is_a_jump_and_several_may_be_something_that_comes_and_goes(hidden, diagnoser, begins, verdict):
    data = hidden(3, {}, plan=(4, 12))
    there = np.sum(np.arange(len(data))[:, None] >= begins, axis=1) % 2
    diagnosis = diagnoser(replace(data, readings=data.readings + there[:, None] * [0.0, 2e-3, 0.0]))
    assert diagnosis.verdict == verdict
    assert {label.partition(":")[0] for label in diagnosis.labels} == {"bias_jump"}
    assert (("unexplained",) in diagnosis.best.equivalents) == (len(begins) > 1)
    assert ("usually imitate one effect" in verdict_of_diagnosis(diagnosis).words()) == (len(begins) > 1)


@pytest.mark.parametrize(
    ("off", "verdict"), [((5, 30), "identified"), ((17, 18), "ambiguous"), ((12, 23), "ambiguous")]
)
def test_positions_off_that_stand_side_by_side_may_be_one_thing(hidden, diagnoser, off, verdict):
    """Apart; measured one after the other; beside each other round the turn."""
    data = hidden(5, {}, plan=(4, 12))
    there = np.isin(np.arange(len(data)), off)
    diagnosis = diagnoser(replace(data, readings=data.readings + there[:, None] * [1.5e-3, -2e-3, 1e-3]))
    assert diagnosis.labels == tuple(sorted(f"outlier_position:{data.names[k]}" for k in off))
    assert diagnosis.verdict == verdict and (("unexplained",) in diagnosis.best.equivalents) == (verdict == "ambiguous")


PATCHED = [
    (["bias_jump:1-2"], 0, False),
    (["bias_jump:1-2", "mount_slip:2-2"], 0, True),
    (["outlier_position:1", "outlier_position:2", "second_order.x"], 0, False),
    (["outlier_position:1", "bias_jump:2-2"], 0, True),
    (["second_order.x", "index_zero", "warm_up"], 0, False),
    (["second_order.x"], 1, False),
    (["bias_jump:1-2"], 1, True),
    ([], 2, True),
    (["mount_drift", "mount_slip:2-2"], 0, True),
    (["bias_drift.x", "mount_slip:2-2"], 0, False),
]


@pytest.mark.parametrize(("labels", "noises", "patched"), PATCHED)
def test_patchwork(labels, noises, patched):
    assert is_patchwork(labels, noises) is patched


@pytest.mark.parametrize(("begins", "axis"), [(8, "y"), (16, "z")])
def test_what_jumps_with_a_change_of_setting_may_be_another_bias_by_setting(hidden, diagnoser, begins, axis):
    """Of 3 x 8 positions: a jump at the first of a setting is a bias by setting of two values; both are hidden, and are one."""
    jump = (np.arange(24) >= begins)[:, None] * 3e-3 * np.eye(3)["xyz".index(axis)]
    jumped = hidden(5, {})
    jumped = replace(jumped, readings=jumped.readings + jump)
    name = f"bias_by_pitch.{axis}"
    by_setting = hidden(5, {name: [3e-3 * (8 * setting >= begins) for setting in (1, 2)]})
    for data in (jumped, by_setting):
        diagnosis = diagnoser(data)
        assert diagnosis.verdict == "ambiguous"
        assert {(f"bias_jump:{data.names[begins]}",), (name,)} <= told(diagnosis)
        # Of the further axes of the family none is needed.
        assert not any(len(labels) > 1 and name in labels for labels in told(diagnosis))


@pytest.mark.parametrize(("begins", "axis"), [(3, "y"), (10, "z")])
def test_what_jumps_within_a_setting_is_a_jump(hidden, diagnoser, begins, axis):
    data = hidden(5, {})
    jump = (np.arange(24) >= begins)[:, None] * 3e-3 * np.eye(3)["xyz".index(axis)]
    diagnosis = diagnoser(replace(data, readings=data.readings + jump))
    assert diagnosis.labels == (f"bias_jump:{data.names[begins]}",) and diagnosis.verdict == "identified"


def test_what_jumps_with_a_new_run_may_be_another_bias_in_each(hidden, diagnoser):
    """The turn-on between two runs of 3 x 8 positions, of one axis."""
    first, second = hidden(5, {}), hidden(5, {})
    late = second.readings + np.random.default_rng(9).normal(0, blind.SIGMA, (24, 3)) + [0.0, 3e-3, 0.0]
    data = replace(
        first,
        names=(*(f"a{name}" for name in first.names), *(f"b{name}" for name in second.names)),
        alpha_deg=np.tile(first.alpha_deg, 2),
        beta_deg=np.tile(first.beta_deg, 2),
        readings=np.concatenate([first.readings, late]),
        sd=np.full((48, 3), blind.SIGMA * np.sqrt(2)),
        run=("1",) * 24 + ("2",) * 24,
        time_s=np.concatenate([first.time_s, second.time_s + 2 * first.time_s[-1]]),
        temperature_degc=np.tile(first.temperature_degc, 2),
        approach=np.tile(first.approach, 2),
    )
    diagnosis = diagnoser(data)
    assert {("bias_jump:b0-1",), ("bias_repeatability",)} <= told(diagnosis) and diagnosis.verdict == "ambiguous"


@pytest.mark.parametrize(
    ("seed", "direction"),
    [(1, [-0.05, -0.6, 0.75]), (5, [0.25, 0.9, -0.15])],
)
def test_along_the_spindle_bias_and_scale_factor_by_setting_are_one_class(hidden, diagnoser, seed, direction):
    """The input of x is the same all through a setting; around the exact fit of the one the other had fewer directions."""
    name = "scale_by_pitch.x"
    diagnosis = diagnoser(hidden(seed, {name: of_size((4, 12), seed, name, direction, 100)}, plan=(4, 12)))
    assert {("bias_by_pitch.x",), (name,)} <= told(diagnosis) and diagnosis.verdict == "ambiguous"


@pytest.mark.parametrize(("seed", "setting"), [(1, 1), (2, 0), (3, 2)])
def test_a_fixture_that_moves_at_one_pitch_setting(hidden, diagnoser, seed, setting):
    """The angles of the mount at one of three settings: it was an index_zero, a slip or unexplained. At the first and the last
    setting it may as well have slipped when the setting was changed."""
    setup = blind.random_setup(np.random.default_rng(seed), 3, 8)
    moved = replace(setup, pitch=np.where(setup.pitch == setting, 0, 1))
    nominal, angles = {**setup.nominal, "dbeta": np.zeros(2)}, np.array([0.4e-3, -0.3e-3, 0.5e-3])
    change = blind.readings(moved, nominal, {"mount_by_pitch": angles}) - blind.readings(moved, nominal, {})
    diagnosis = diagnoser(hidden(seed, {}, change=lambda readings, rng: readings + change))
    assert ("mount_by_pitch",) in told(diagnosis)
    if setting == 1:
        assert diagnosis.labels == ("mount_by_pitch",) and diagnosis.verdict == "identified"
        assert diagnosis.members[0].slot.names == ("mount_by_pitch_x_1", "mount_by_pitch_y_1", "mount_by_pitch_z_1")
        assert not extended_rig_text(diagnosis)  # there it would move at the first setting
    else:
        assert diagnosis.verdict == "ambiguous"
        assert any(labels[0].startswith("mount_slip") for labels in told(diagnosis))


def test_no_scale_factor_that_no_sensor_has_explains_a_bias_where_the_input_is_near_zero(hidden, diagnoser):
    """An offset of y at beta 90, where its input is some mg: a scale factor beyond 0.1 g/g there was in the class."""
    there = blind.random_setup(np.random.default_rng(1), 3, 8).pitch == 2
    offset = there[:, None] * np.array([0.0, 1.5e-3, 0.0])
    diagnosis = diagnoser(hidden(1, {}, change=lambda readings, rng: readings + offset))
    assert ("bias_by_pitch.y",) in told(diagnosis)
    assert not any("scale_by_pitch.y" in labels for labels in told(diagnosis))


def test_listed_causes_lead_in_the_place_of_one_without_a_name_from_a_probability_of_a_tenth_on():
    none, cubic, square, unnamed = (), ("third_order.x",), ("second_order.x",), ("unexplained",)
    labels = [unnamed, none, cubic, square, ("unexplained", "second_order.x")]
    assert named_in_place(labels, [0.7, 0.1, 0.12, 0.05, 0.03], {}) == (2, 0)
    # Those of one signal count together, and the most probable of them leads.
    assert named_in_place(labels, [0.8, 0.05, 0.06, 0.05, 0.04], {2: {3: 1.0}, 3: {2: 1.0}}) == (2, 0)
    assert named_in_place(labels, [0.8, 0.05, 0.06, 0.05, 0.04], {}) is None
    # Adequate is no cause, and a set with a cause without a name is no listed one.
    assert named_in_place(labels, [0.5, 0.3, 0.05, 0.05, 0.1], {}) is None
    assert named_in_place([cubic, unnamed], [0.6, 0.4], {}) is None


def test_a_listed_set_that_leads_in_the_place_of_a_larger_one_without_a_name_is_not_claimed():
    square, more = ("second_order.x",), ("second_order.x", "unexplained")
    for own, other in ((0.15, 0.8), (0.9, 0.08)):
        led = Explanation(square, (more,), own, (other,), (3,), at_any_odds=(more,))
        assert led.separable == (more,) and led.probability == own + other
        assert verdict_of(led, False, False, False) == "ambiguous"
    assert Explanation(more, (square,), 0.8, (0.15,), (3, 9)).separable == ()
