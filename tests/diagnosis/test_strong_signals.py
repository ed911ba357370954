"""Strong effects, several gross positions, effects on all axes: blind cases in plain numpy, a few of each kind.

How often each is found is counted by `benchmarks/blind catalogue`.
"""

import zlib
from dataclasses import replace

import numpy as np
import pytest
from test_rates import least

import blind_instrument as blind
from blind import catalogue as study
from blind.conditions import CONDITIONS, drawn, positions_of
from blind.judge import against
from blind_noise import position_set
from blind_sets import classes
from tumblecal.effects.rig_with_effects import read_rig_with_effects
from tumblecal.estimation.setup.correction import correct_setup_errors
from tumblecal.simulation.position_means import simulated


@pytest.fixture(scope="module")
def bench():
    return study.Bench()


def effects(names, sizes, plan="3x8", most_cosine=None):
    """Draws an instrument with effects of these sizes in sigma; `names`: of them, or how they are drawn."""
    names_of = names if callable(names) else lambda rng: names
    return lambda rng: study.hidden(rng, plan, names_of, sizes, most_cosine=most_cosine)


def a_jump(rng):
    return [f"bias_asymmetry.{rng.choice(list('xyz'))}"]


def with_outliers(outliers, count, plan="3x8", size=12):
    """Draws so many gross positions beside so many effects."""

    def draw(rng):
        case = study.hidden(rng, plan, study.several(count), (8,) * count)
        projector, measured = blind.unreachable(case.setup), case.measured.copy()
        positions = rng.choice(len(measured), outliers, replace=False)
        for position in positions:
            off = np.zeros_like(measured)
            off[position] = rng.normal(size=3)
            measured += off * size * blind.SIGMA / np.linalg.norm(projector @ off.ravel())
        labels = [f"outlier_position:{case.setup.names[position]}" for position in positions]
        return study.Hidden(case.setup, measured, tuple(sorted([*case.truth, *labels])), case.clean, case.effects)

    return draw


def swapped_beside(size):
    """An effect of this size, and two positions exchanged that read almost the same (12 to 60 sigma in the residuals)."""

    def draw(rng):
        while True:
            case = study.hidden(rng, "3x8", study.several(1), (size,))
            measured = case.measured.copy()
            pair = sorted(rng.choice(len(measured), 2, replace=False))
            measured[pair] = measured[pair[::-1]]
            apart = np.linalg.norm(blind.unreachable(case.setup) @ (measured - case.measured).ravel())
            if 12 * blind.SIGMA < apart < 60 * blind.SIGMA:
                label = "swapped_positions:" + "+".join(case.setup.names[k] for k in pair)
                return study.Hidden(case.setup, measured, tuple(sorted([*case.truth, label])), case.clean, case.effects)

    return draw


HEAD = ("axis_perpendicularity", "base_levelling")
# How it is drawn, whether the noise is stated, and the number of cases.
STRONG = {
    "two of 100 sigma": (effects(study.several(2), (100, 100), most_cosine=0.5), True, 2),
    "three of 30 sigma": (effects(study.several(3), (30, 30, 30), most_cosine=0.5), True, 2),
    "one of 1000 sigma": (effects(study.several(1), (1000,), most_cosine=0.5), False, 2),
    # A large jump spoils the signs of inputs near zero, at which positions looked faulty.
    "a jump": (effects(a_jump, (1000,)), True, 2),
    "a jump, noise unknown": (effects(a_jump, (1000,)), False, 2),
    "a jump at few positions": (effects(a_jump, (1000,), "3x4"), True, 2),
    "a jump and a level": (effects(("base_levelling", "bias_asymmetry.z"), (300, 300)), False, 3),
    "a jump and a gain of the index": (effects(("index_gain", "bias_asymmetry.y"), (300, 300)), False, 3),
    "a cubic and a gain of the index": (effects(("third_order.y", "index_gain"), (300, 20), "4x12"), True, 2),
    # Where the spindle points up an index in error by any angle explains anything.
    "what every head has": (effects(HEAD, (50, 50), most_cosine=1.0), True, 2),
    "what every head has, 4x12": (effects(HEAD, (50, 50), "4x12", most_cosine=1.0), True, 2),
    "an index in error by less": (effects(("index_zero",), (100,)), True, 2),
    "two gross positions, noise unknown": (with_outliers(2, 0), False, 2),
    "three gross positions and an effect": (with_outliers(3, 1), True, 2),
    # The level of the noise was told from residuals with the effect in them.
    "a swap and an effect of 1000 sigma, noise unknown": (swapped_beside(1000), False, 2),
}


@pytest.mark.long
@pytest.mark.parametrize(("draw", "known", "cases"), STRONG.values(), ids=STRONG)
def test_the_hidden_set_is_in_the_class(bench, draw, known, cases):
    for seed in range(cases):
        case = draw(np.random.default_rng([8, seed]))
        screened, noise = bench(case, known)
        assert against(screened.best, case.truth, noise).right, (seed, case.truth, screened.best.labels)


@pytest.mark.long
@pytest.mark.parametrize(
    ("condition", "cases", "right"),
    [
        ("swap beside a jump at zero input, d = 1000", 4, 3),
        # Two causes of three coefficients each, and three of them.
        ("bias and scale factor in a chamber, d = 10 each", 2, 2),
        ("bias, scale factor and a wobble in a chamber, d = 100 each", 2, 2),
        ("bias, its square and scale factor in a chamber, d = 100 each", 1, 1),
        # The position before is what the triad measured, not what was commanded.
        ("10 deg mount, the position before, d = 1000", 2, 2),
        ("remounted, one met less often, d = 8", 2, 2),
    ],
)
def test_conditions_of_the_stress_study(diagnoser, monkeypatch, condition, cases, right):
    """The hidden set is in the class; on 3 x 8 positions, which are compiled for other tests as well."""
    monkeypatch.setitem(CONDITIONS, condition, replace(CONDITIONS[condition], plans=("3x8",)))
    rng, count = np.random.default_rng([1710, zlib.crc32(condition.encode())]), 0
    for _ in range(cases):
        case = drawn(condition, rng)
        diagnosis = diagnoser(positions_of(case.data))
        told = [tuple(sorted(labels)) for labels in classes(diagnosis)]
        count += case.accepted[0] in told and not diagnosis.noise_wrong
    assert count >= right


@pytest.mark.long
def test_at_few_positions_gross_ones_do_not_hide_anything_in_unknown_noise(bench):
    """Each makes the noise look larger: in many of these nothing was detected, though both together leave no doubt."""
    draw, cases = with_outliers(2, 0, "3x4", size=8), 12
    detected = 0
    for seed in range(cases):
        screened, noise = bench(draw(np.random.default_rng([8, seed])), False)
        detected += bool(noise) or screened.detection.detected
    assert detected >= least(0.72, cases)


@pytest.mark.parametrize("name", ["scale_drift.x", "third_order.x"])
def test_an_effect_of_tenths_of_a_g_is_no_mislabelled_setting(name):
    """It looked like one, which explained a third of it, and the data were put wrong."""
    for seed in range(2):
        case = effects((name,), (1000,), "4x12")(np.random.default_rng([9, seed]))
        mended, setup_errors = correct_setup_errors(position_set(case.setup, case.measured, known=True))
        assert not setup_errors and np.array_equal(mended.beta_deg, np.degrees(case.setup.beta))


@pytest.mark.long
def test_noise_a_million_times_smaller_than_the_effects_is_told_from_them(diagnoser, configs):
    """What was left counted as rounding there, and its random pattern as coloured noise. A simulation of the chain itself: of
    another simulator the second order would show."""
    data = simulated(read_rig_with_effects(configs / "hidden_effect.toml"), 0, 1e-10)
    diagnosis = diagnoser(data)
    assert ("bias_drift.x", "second_order.z") in [tuple(sorted(labels)) for labels in classes(diagnosis)]
    assert not diagnosis.noise_wrong and diagnosis.sigma_g == pytest.approx(1e-10, rel=0.3)
