"""A class of explanations is written as a product of findings; what is one function at 1 g is one cause."""

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from tumblecal.diagnosis.causes.cause import NO_SLOT
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.findings.factors import Factor, Reason, factors_of
from tumblecal.diagnosis.sets.explanation import Explanation, verdict_of
from tumblecal.diagnosis.sets.prior import given_found
from tumblecal.effects import catalogue
from tumblecal.effects.added_terms import output_effect
from tumblecal.report.cause_words import less_probable_words


ROOT = Path(__file__).parents[2]
ENTRIES = catalogue()
TIME = np.linspace(0.0, 4.0, 24)
COLUMNS = {"time_s": TIME, "temperature_degc": 24.0 + 0.6 * TIME}


def told(best, *equivalents, identical=(), at_any_odds=(), apart=None, own=0.5, shares=None):
    """A class of explanations by hand, its members as texts; where no probabilities are given the equivalents share 0.46."""
    sets = [tuple(words.split()) for words in equivalents]
    return Explanation(
        labels=tuple(best.split()),
        equivalents=tuple(sets),
        own_probability=own,
        shares=tuple([0.46 / len(sets)] * len(sets) if shares is None else shares),
        members=(0,),
        identical=tuple(tuple(words.split()) for words in identical),
        at_any_odds=tuple(tuple(words.split()) for words in at_any_odds),
        apart=tuple([0.1] * len(sets) if apart is None else apart),
    )


def shown(factor: Factor) -> str:
    return " | ".join("+".join(labels) for labels in factor.members)


# The class of the case in the README: the rate of x follows the time or the temperature, z has one of two squares.
README = told(
    "bias_drift.x second_order.z",
    "bias_temperature.x second_order.z",
    "bias_drift.x cross_axis_square.z",
    "bias_temperature.x cross_axis_square.z",
    "bias_temperature.x second_order.y second_order.z",
    "bias_temperature.x bias_temperature.y second_order.z",
    "second_order.z warm_up",
    identical=["bias_drift.x cross_axis_square.z"],
)


def test_a_class_that_is_a_product_is_two_factors_with_their_reasons():
    drift, square = factors_of(README, ENTRIES, COLUMNS)
    assert shown(drift) == "bias_drift.x | bias_temperature.x | warm_up"
    assert shown(square) == "second_order.z | cross_axis_square.z"
    assert drift.reasons == (
        Reason("columns", ("time_s", "temperature_degc"), pytest.approx(1.0)),
        Reason("range", ("time_s",)),
    )
    assert square.reasons == (Reason("identity"),)
    assert (drift.resolved, square.resolved) == (False, True)
    assert len(README.supersets) == 2 and not README.single_name
    assert README.separable == (
        ("bias_temperature.x", "second_order.z"),
        README.equivalents[2],
        README.equivalents[-1],
    )


def test_columns_that_are_not_correlated_are_no_reason():
    columns = COLUMNS | {"temperature_degc": 25.0 + np.sin(TIME * 5)}
    drift, _ = factors_of(README, ENTRIES, columns)
    assert drift.reasons[0] == Reason("angles")


def test_an_error_three_times_as_large_that_would_be_told_apart_is_too_small():
    """Told apart from three noise sd on: of 1.1 that it leaves now, three times as much; of 0.9 not."""
    (factor,) = factors_of(
        told("second_order.x", "scale_asymmetry.x", "third_order.x", apart=[1.1, 0.9]), ENTRIES, COLUMNS
    )
    assert factor.reasons == (Reason("size"), Reason("angles"))


def test_what_is_exchanged_together_is_one_factor_beside_the_rest():
    """Two causes for one, a family for another family, a fault that stays, something without a name."""
    (one,) = factors_of(told("cross_axis_square.y", "bias_drift.y second_order.y"), ENTRIES, COLUMNS)
    assert shown(one) == "cross_axis_square.y | bias_drift.y+second_order.y"
    x, y, fault = factors_of(
        told(
            "second_order.x second_order.y outlier_position:1-2",
            "cross_axis_square.x cross_axis_square.y outlier_position:1-2",
            identical=["cross_axis_square.x cross_axis_square.y outlier_position:1-2"],
        ),
        ENTRIES,
        COLUMNS,
    )
    # An identity holds for each axis alone.
    assert shown(x) == "second_order.x | cross_axis_square.x" and shown(y) == "second_order.y | cross_axis_square.y"
    assert fault == Factor((("outlier_position:1-2",),)) and fault.resolved
    (unnamed,) = factors_of(told("second_order.z", "unexplained"), ENTRIES, COLUMNS)
    assert unnamed.reasons == (Reason("unnamed"),)


def test_a_product_of_which_the_class_holds_a_corner_alone():
    """Both exchanged at once; one of them alone is in the class, and what remains is the other."""
    first, second = factors_of(
        told("bias_drift.x second_order.z", "bias_temperature.x second_order.z", "bias_temperature.x index_gain"),
        ENTRIES,
        COLUMNS,
    )
    assert shown(first) == "bias_drift.x | bias_temperature.x" and shown(second) == "second_order.z | index_gain"


def verdict(best, *equivalents, **given):
    return verdict_of(told(best, *equivalents, **given), False, False, False)


def test_an_identity_at_1_g_is_identified_and_a_superset_adds_nothing():
    alike = "cross_axis_square.z", "cross_axis_square.y cross_axis_square.z"
    assert verdict("second_order.z", *alike, identical=alike[:1], own=0.6, shares=[0.3, 0.0]) == "identified"
    assert verdict("second_order.z", *alike, own=0.6, shares=[0.3, 0.0]) == "ambiguous"
    assert verdict("second_order.z", *alike, identical=alike[:1], own=0.4, shares=[0.3, 0.0]) == "ambiguous"


def test_a_set_of_causes_is_identified_by_the_probability_of_it_alone():
    """The same signal is no reason for doubt while the other causes of it have less than a fifth of all probability together;
    the probability stated is then that of the named set alone, otherwise that of the class."""
    orders = told("third_order.x", "fifth_order.x", own=0.84, shares=[0.12])
    assert orders.single_name and orders.probability == 0.84 and orders.class_probability == pytest.approx(0.96)
    assert verdict_of(orders, False, False, False) == "identified"
    assert factors_of(orders, ENTRIES, COLUMNS) == (Factor((("third_order.x",),)),)
    said = "less probable causes of the same signal: fifth_order.x (probability 0.12)"
    assert list(less_probable_words(orders)) == [said]
    columns = told("bias_drift.x", "bias_temperature.x", "warm_up", own=0.6, shares=[0.35, 0.01])
    assert columns.separable == (("bias_temperature.x",),) and columns.probability == pytest.approx(0.96)
    assert columns.less_probable == ((("warm_up",), 0.01),) and not [*less_probable_words(columns)]
    assert verdict_of(columns, False, False, False) == "ambiguous"
    # Nothing but the evidence against all else makes a set of 0.75 less than sure.
    alone = told("bias_drift.x", "warm_up", own=0.75, shares=[0.01])
    assert alone.single_name and verdict_of(alone, False, False, False) == "ambiguous"


def test_noise_alone_is_identified_by_its_probability_too():
    """One threshold for every kind of statement: 0.96 of the causes, given a noise of 0.75, make 0.72 of both."""
    noise = told("", own=0.96, shares=[])
    assert (
        verdict_of(noise, True, False, False) == "identified" and verdict_of(noise, False, False, False) == "adequate"
    )
    doubted = noise.times(0.75)
    assert doubted.probability == pytest.approx(0.72) and verdict_of(doubted, True, False, False) == "ambiguous"
    assert verdict_of(doubted, False, False, False) == "adequate"
    effect = told("index_gain", "index_third", own=0.9, shares=[0.05]).times(0.6)
    assert effect.class_probability == pytest.approx(0.57) and verdict_of(effect, True, False, False) == "ambiguous"


def test_faults_found_before_count_as_causes():
    """`SIZE_PRIOR` 0.25, 0.69, 0.05 with the orders of a set: none given one is 0.69 to 2 * 0.05, not 0.25 to 0.69."""
    causes = np.arange(3)
    assert not given_found(causes, 0).any()
    assert given_found(causes, 1)[1] == pytest.approx(np.log(2 * 0.05 / 0.69) - np.log(0.69 / 0.25))
    assert given_found(causes, 2)[1] == pytest.approx(np.log(6 * 0.004 / 0.1) - np.log(0.69 / 0.25))
    # Beyond the largest set each further cause is as rare as its last.
    assert given_found(np.array([4]), 1) == pytest.approx(np.log(24 * 0.0003 / 0.024) - np.log(0.69 / 0.25))


def test_pieces_of_one_thing_and_what_has_no_name_are_doubted_at_any_odds():
    pieces = "bias_jump:1-2 bias_jump:2-2", "unexplained"
    assert verdict(*pieces, own=0.95, shares=[0.001]) == "identified"
    assert verdict(*pieces, own=0.95, shares=[0.001], at_any_odds=pieces[1:]) == "ambiguous"
    assert verdict("unexplained", "fifth_order.x", own=0.95, shares=[0.001]) == "ambiguous"
    assert verdict("unexplained", own=0.95, shares=[]) == "unexplained"


def test_effects_of_the_sensor_that_are_one_function_at_1_g():
    """All pairs of the catalogue, by rank, and by polynomials on the unit sphere: those of docs/diagnosis_rules.md."""
    slots = {}
    for effect in ENTRIES.values():
        if effect.id.startswith(("second", "third", "fifth", "cross", "scale_asym", "bias_temp")):
            columns = tuple(range(max(1, len(effect.forms))))
            parameter = effect.over_temperature
            slots[effect.id] = replace(
                NO_SLOT, id=effect.id, make=effect.make, columns=columns, over_temperature=parameter
            )
    pairs = {(a, b) for a, b in combinations(slots, 2) if one_function_at_1_g([slots[a]], [slots[b]])}
    assert pairs == {(f"second_order.{axis}", f"cross_axis_square.{axis}") for axis in "xyz"}
    text = (ROOT / "docs/diagnosis_rules.md").read_text()
    assert all(f"| `{a}` | `{b}` |" in text for a, b in pairs)


def test_sets_of_effects_are_compared_as_a_whole():
    slots = {id: replace(NO_SLOT, id=id, make=ENTRIES[id].make, columns=(0,)) for id in ENTRIES if ENTRIES[id].make}
    x, y = ([slots[f"second_order.{axis}"], slots[f"cross_axis_square.{axis}"]] for axis in "xy")
    assert one_function_at_1_g([x[0], y[0]], [x[1], y[1]])
    assert not one_function_at_1_g([x[0], y[0]], [x[1], slots["third_order.y"]])
    assert not one_function_at_1_g([x[0]], [slots["bias_drift.x"], y[1]])
    # A shape of the head at some angles is no identity, nor is an error of a position.
    assert not one_function_at_1_g([x[0]], [slots["fixture_flexure"]]) and not one_function_at_1_g([x[0]], [NO_SLOT])


def test_an_identity_of_an_effect_of_the_users():
    """By Legendre's polynomial, 3 u_z^2 - 1, on the sphere u_x^2 + u_y^2 - 2 u_z^2 = 1 - 3 u_z^2."""
    own = output_effect(
        "mine.z",
        "z",
        lambda u, where: u[0] ** 2 + u[1] ** 2 - 2 * u[2] ** 2,
        unit="mg",
        typical=0.1,
        physics="",
        cause="",
    )
    slots = [
        replace(NO_SLOT, id=effect.id, make=effect.make, columns=(0,))
        for effect in (own, ENTRIES["second_order.z"], ENTRIES["second_order.y"])
    ]
    assert one_function_at_1_g(slots[:1], slots[1:2]) and not one_function_at_1_g(slots[:1], slots[2:])


def test_powers_of_a_polynomial_are_one_factor_and_fewer_of_them_no_other_explanation():
    best = told(
        "bias_temperature.x bias_temperature_square.x second_order.z",
        "bias_temperature_square.x second_order.z",
        "bias_drift.x bias_drift_square.x second_order.z",
        "bias_temperature.x bias_temperature_square.x cross_axis_square.z",
        identical=["bias_temperature.x bias_temperature_square.x cross_axis_square.z"],
        own=0.3,
        shares=[0.1, 0.35, 0.2],
    )
    assert best.separable == (("bias_drift.x", "bias_drift_square.x", "second_order.z"),)
    assert best.supersets == ()
    bias, square = factors_of(best, ENTRIES, COLUMNS)
    assert shown(bias) == "bias_temperature.x+bias_temperature_square.x | bias_drift.x+bias_drift_square.x"
    assert shown(square) == "second_order.z | cross_axis_square.z"
    nested = told("bias_drift.y", "bias_drift.y bias_drift_square.y")
    assert nested.single_name and verdict_of(nested, False, False, False) == "identified"
    whole = told("bias_drift.y bias_drift_square.y", "bias_drift.y")
    assert whole.single_name and verdict_of(whole, False, False, False) == "identified"
    # Where no member of the class joins them either.
    (factor,) = factors_of(whole, ENTRIES, COLUMNS)
    assert factor.members == (("bias_drift.y", "bias_drift_square.y"),) and factor.resolved
