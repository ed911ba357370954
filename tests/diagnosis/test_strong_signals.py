"""Strong effects, several gross positions, effects on all axes: blind cases in plain numpy, a few of each kind.

How often each is found is counted by `benchmarks/blind_study.py`; its simulator `seeds` has the cases that once failed.
"""

import zlib
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_rates import least

import blind_catalogue as study
import blind_instrument as blind
from blind_conditions import CONDITIONS, drawn, positions_of
from blind_judge import right as is_right
from blind_noise import position_set
from tumblecal.data import read_positions
from tumblecal.effects.catalogue import read_rig_with_effects
from tumblecal.estimation.setup_correction import correct_setup_errors
from tumblecal.simulation.position_means import simulated


CASES = 2
WITH_WOBBLE = "bias, scale factor and a wobble"


@pytest.fixture(scope="module")
def bench():
    return study.Bench()


def named(bench, known, draw, cases=CASES):
    """In how many cases the hidden set is the best explanation or one of its equals."""
    count = 0
    for seed in range(cases):
        case = draw(np.random.default_rng([8, seed]))
        screened, noise = bench(case, known)
        count += is_right(screened.best, case.truth, noise)
    return count


@pytest.mark.parametrize(("sizes", "known"), [((100, 100), True), ((30, 30, 30), True), ((1000,), False)])
def test_strong_effects_are_the_easiest(bench, sizes, known):
    names_of = study.several(len(sizes))
    count = named(bench, known, lambda rng: study.hidden(rng, "3x8", names_of, sizes, most_cosine=0.5))
    assert count == CASES


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("plan", ["3x4", "3x8"])
def test_a_large_jump_at_zero_input_is_found_though_it_spoils_the_signs(bench, known, plan):
    def jump(rng):
        return [f"bias_asymmetry.{rng.choice(list('xyz'))}"]

    count = named(bench, known, lambda rng: study.hidden(rng, plan, jump, (1000,)))
    assert count == CASES


@pytest.mark.parametrize("names", [("base_levelling", "bias_asymmetry.z"), ("index_gain", "bias_asymmetry.y")])
def test_a_large_jump_is_found_beside_another_large_effect(bench, names):
    """Exact fits began without the other effect: inputs near zero took other signs, and positions looked faulty."""
    count = named(bench, False, lambda rng: study.hidden(rng, "3x8", lambda _: names, (300, 300)), 3)
    assert count == 3


@pytest.mark.parametrize("plan", ["3x8", "4x12"])
def test_two_errors_that_every_head_has_are_no_index_off_by_radians(bench, plan):
    """Where the spindle points up an index off by any angle explains anything: it was named, surely, in each of these."""
    names = ("axis_perpendicularity", "base_levelling")
    right = named(bench, True, lambda rng: study.hidden(rng, plan, lambda _: names, (50, 50), most_cosine=1.0))
    assert right == CASES


def test_an_index_off_by_less_is_named(bench):
    def draw(rng):
        return study.hidden(rng, "3x8", lambda _: ("index_zero",), (100,))

    assert named(bench, True, draw) == CASES


def test_large_effects_that_do_not_jump_are_named(bench):
    for seed in range(CASES):
        case = study.hidden(
            np.random.default_rng([10, seed]), "4x12", lambda _: ["third_order.y", "index_gain"], (300, 20)
        )
        screened, noise = bench(case, bool(seed % 2))
        assert is_right(screened.best, case.truth, noise)


def with_outliers(outliers, effects, plan="3x8", size=12):
    def draw(rng):
        case = study.hidden(rng, plan, study.several(effects), (8,) * effects)
        projector, measured = blind.unreachable(case.setup), case.measured.copy()
        positions = rng.choice(len(measured), outliers, replace=False)
        for position in positions:
            off = np.zeros_like(measured)
            off[position] = rng.normal(size=3)
            measured += off * size * blind.SIGMA / np.linalg.norm(projector @ off.ravel())
        labels = [f"outlier_position:{case.setup.names[position]}" for position in positions]
        return study.Hidden(case.setup, measured, tuple(sorted([*case.truth, *labels])), case.clean, case.effects)

    return draw


@pytest.mark.parametrize(("outliers", "effects", "known"), [(2, 0, False), (3, 1, True)])
def test_several_gross_positions_are_named(bench, outliers, effects, known):
    assert named(bench, known, with_outliers(outliers, effects)) == CASES


def test_at_few_positions_gross_ones_do_not_hide_anything_in_unknown_noise(bench):
    """Each makes the noise look larger: in many of these nothing was detected, though both together leave no doubt."""
    draw, cases = with_outliers(2, 0, "3x4", size=8), 12
    detected = 0
    for seed in range(cases):
        screened, noise = bench(draw(np.random.default_rng([8, seed])), False)
        detected += bool(noise) or screened.detection.detected
    assert detected >= least(0.72, cases)


@pytest.mark.parametrize("name", ["scale_drift.x", "third_order.x", "scale_temperature.x"])
def test_an_effect_of_tenths_of_a_g_is_no_mislabelled_setting(name):
    """It looked like one, which explained a third of it, and the data were put wrong."""
    for seed in range(CASES):
        case = study.hidden(np.random.default_rng([9, seed]), "4x12", lambda _: (name,), (1000,))
        mended, setup_errors = correct_setup_errors(position_set(case.setup, case.measured, known=True))
        assert not setup_errors and np.array_equal(mended.beta_deg, np.degrees(case.setup.beta))


def test_a_mislabelled_setting_stays_one_beside_what_is_not_named(diagnoser):
    """Weighed against the angles as written, whose pitch error would be what no head has."""
    for seed in range(CASES):
        case = study.hidden(np.random.default_rng([11, seed]), "4x12", study.several(2), (30, 30))
        data = position_set(case.setup, case.measured, known=True)
        data = replace(data, beta_deg=np.where(np.abs(data.beta_deg - 30) < 1, 42.0, data.beta_deg))
        assert [slip.label for slip in diagnoser(data).setup_errors] == ["mislabelled_setting"]


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


def test_in_unknown_noise_a_swap_is_found_beside_a_large_effect(bench):
    """The level of the noise was told from residuals with the effect in them: the swap was lost in it."""
    assert named(bench, False, swapped_beside(1000)) == CASES


@pytest.fixture
def on_one_plan(monkeypatch):
    """The stress study's conditions on 3 x 8 positions alone, which are compiled for other tests as well."""
    for name, condition in CONDITIONS.items():
        monkeypatch.setitem(CONDITIONS, name, replace(condition, plans=("3x8",)))


def told_right(diagnoser, condition, cases):
    """In how many cases of a condition of the stress study the hidden set is the best explanation or one of its equals."""
    rng, right = np.random.default_rng([1710, zlib.crc32(condition.encode())]), 0
    for _ in range(cases):
        case = drawn(condition, rng)
        diagnosis = diagnoser(positions_of(case.data))
        told = [diagnosis.labels, *diagnosis.best.equivalents]
        right += case.accepted[0] in [tuple(sorted(labels)) for labels in told] and not diagnosis.noise_wrong
    return right


@pytest.mark.usefixtures("on_one_plan")
def test_a_swap_is_found_beside_a_jump_at_zero_input(diagnoser):
    """The signs were sought in readings of which two were exchanged: none of them explained these."""
    condition = "swap beside a jump at zero input, d = 1000"
    assert told_right(diagnoser, condition, 4) >= 3


@pytest.mark.usefixtures("on_one_plan")
@pytest.mark.parametrize(("words", "size"), [("bias and scale factor", 10), (WITH_WOBBLE, 100)])
def test_a_run_in_a_chamber_has_six_coefficients(diagnoser, words, size):
    """Bias and scale factor of all axes follow the temperature: two causes of three coefficients each, more than a set had."""
    assert told_right(diagnoser, f"{words} in a chamber, d = {size} each", CASES) == CASES


@pytest.mark.usefixtures("on_one_plan")
def test_a_run_in_a_chamber_may_have_nine_coefficients(diagnoser):
    """Three causes of three coefficients were not tried where one curve without a name was better than two of them; found under
    a noise that had been corrected for what was left, they were not looked at under the noise as stated."""
    condition = "bias, its square and scale factor in a chamber, d = 100 each"
    assert told_right(diagnoser, condition, 1) == 1


@pytest.mark.parametrize("seed", range(2))
def test_attitudes_unknown_an_effect_as_large_as_the_inputs_stops_nothing(diagnoser, tmp_path, seed):
    """The robust start ran away there, and the model was said to be singular."""
    rng = np.random.default_rng([87, seed])
    f = Rotation.random(24, random_state=rng).apply([0.0, 0.0, 1.0])
    readings = f + np.abs(f) * [0.0, rng.uniform(1.0, 2.5), 0.0] + 1e-4 * rng.normal(size=f.shape)
    rows = [",".join([f"p{k}", *map(repr, row)]) for k, row in enumerate(readings.tolist())]
    (tmp_path / "hand.csv").write_text("\n".join(["# attitudes: unknown", "position,ax_g,ay_g,az_g", *rows]) + "\n")
    diagnosis = diagnoser(read_positions(tmp_path / "hand.csv"))
    assert diagnosis.verdict in ("identified", "ambiguous", "unexplained")


@pytest.mark.parametrize("noise_sd_g", [1e-10])
def test_noise_a_million_times_smaller_than_the_effects_is_told_from_them(diagnoser, configs, noise_sd_g):
    """What was left counted as rounding there, and its random pattern as coloured noise. A simulation of the chain itself: of
    another simulator the second order would show."""
    data = simulated(read_rig_with_effects(configs / "hidden_effect.toml"), 0, noise_sd_g)
    diagnosis = diagnoser(data)
    told = [diagnosis.best.labels, *diagnosis.best.equivalents]
    assert ("bias_drift.x", "second_order.z") in [tuple(sorted(labels)) for labels in told]
    assert not diagnosis.noise_wrong and diagnosis.sigma_g == pytest.approx(noise_sd_g, rel=0.3)
