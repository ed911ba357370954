"""Causes that make the same signal on a plan are one class, whatever their priors, with or without a name."""

import numpy as np

import blind_instrument as blind


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
