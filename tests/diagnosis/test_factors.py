"""A class of explanations is written as a product of findings; what is one function at 1 g is one cause."""

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from tumblecal.diagnosis.causes.cause import NO_SLOT
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.findings.factors import factors_of
from tumblecal.diagnosis.sets.explanation import Explanation, verdict_of
from tumblecal.diagnosis.sets.prior import given_found
from tumblecal.effects import catalogue
from tumblecal.effects.added_terms import output_effect


ROOT = Path(__file__).parents[2]
ENTRIES = catalogue()
TIME = np.linspace(0.0, 4.0, 24)
COLUMNS = {"time_s": TIME, "temperature_degc": 24.0 + 0.6 * TIME}
NOT_CORRELATED = COLUMNS | {"temperature_degc": 25.0 + np.sin(TIME * 5)}


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
ALIKE = "cross_axis_square.z", "cross_axis_square.y cross_axis_square.z"
PIECES = "bias_jump:1-2 bias_jump:2-2", "unexplained"
POWERS = told(
    "bias_temperature.x bias_temperature_square.x second_order.z",
    "bias_temperature_square.x second_order.z",
    "bias_drift.x bias_drift_square.x second_order.z",
    "bias_temperature.x bias_temperature_square.x cross_axis_square.z",
    identical=["bias_temperature.x bias_temperature_square.x cross_axis_square.z"],
    own=0.3,
    shares=[0.1, 0.35, 0.2],
)
FAMILY = "cross_axis_square.x cross_axis_square.y outlier_position:1-2"
CASES = {
    "README": README,
    # Three times as large they would be separated from three standard deviations of the noise on: 1.1 yes, 0.9 no.
    "too small": told("second_order.x", "scale_asymmetry.x", "third_order.x", apart=[1.1, 0.9]),
    "two for one": told("cross_axis_square.y", "bias_drift.y second_order.y"),
    "family for family": told("second_order.x second_order.y outlier_position:1-2", FAMILY, identical=[FAMILY]),
    "a corner of a product": told(
        "bias_drift.x second_order.z", "bias_temperature.x second_order.z", "bias_temperature.x index_gain"
    ),
    "identity at 1 g": told("second_order.z", *ALIKE, identical=ALIKE[:1], own=0.6, shares=[0.3, 0.0]),
    "no identity": told("second_order.z", *ALIKE, own=0.6, shares=[0.3, 0.0]),
    "identity, not probable": told("second_order.z", *ALIKE, identical=ALIKE[:1], own=0.4, shares=[0.3, 0.0]),
    "same signal, less than a fifth": told("third_order.x", "fifth_order.x", own=0.84, shares=[0.12]),
    "same signal, more": told("bias_drift.x", "bias_temperature.x", "warm_up", own=0.6, shares=[0.35, 0.01]),
    "alone and not sure": told("bias_drift.x", "warm_up", own=0.75, shares=[0.01]),
    "pieces": told(*PIECES, own=0.95, shares=[0.001]),
    "pieces, doubted at any odds": told(*PIECES, own=0.95, shares=[0.001], at_any_odds=PIECES[1:]),
    "no name": told("unexplained", own=0.95, shares=[]),
    "no name or one": told("unexplained", "fifth_order.x", own=0.95, shares=[0.001]),
    "powers": POWERS,
    "fewer powers": told("bias_drift.y", "bias_drift.y bias_drift_square.y"),
    "more powers": told("bias_drift.y bias_drift_square.y", "bias_drift.y"),
}


def words(best, columns=COLUMNS):
    """Verdict and probability, each factor with its reasons, and what is not in the product."""
    lines = [f"{verdict_of(best, False, False, False)}, probability {best.probability:.3g}"]
    for factor in factors_of(best, ENTRIES, columns):
        members = " | ".join("+".join(labels) for labels in factor.members)
        reasons = "; ".join(" ".join([own.kind, *own.columns]) for own in factor.reasons)
        lines.append(f"{members}: {reasons or 'no other'}{', resolved' if factor.resolved else ''}")
    for title in ("separable", "supersets"):
        if listed := getattr(best, title):
            lines.append(f"{title}: " + " | ".join("+".join(labels) for labels in listed))
    lines += [f"less probable: {'+'.join(labels)} {share:.2f}" for labels, share in best.less_probable if share >= 0.02]
    return "\n".join(lines)


def test_factors_verdicts_and_probabilities(snapshot):
    texts = {title: words(best) for title, best in CASES.items()}
    snapshot("factors", texts | {"README, columns not correlated": words(README, NOT_CORRELATED)})


@pytest.mark.parametrize(
    ("labels", "noise", "implausible", "doubtful", "verdict"),
    [
        ("index_gain", False, False, False, "identified"),
        ("index_gain", False, True, False, "ambiguous"),
        ("index_gain", False, False, True, "ambiguous"),
        ("", False, False, False, "adequate"),
        ("", False, True, False, "unexplained"),
        ("", True, False, False, "identified"),
    ],
)
def test_doubts_decide_the_verdict(labels, noise, implausible, doubtful, verdict):
    best = told(labels, own=0.97, shares=[])
    assert verdict_of(best, noise, implausible, doubtful) == verdict
    # A probability below that of a sure set is a doubt as well.
    if noise:
        assert verdict_of(best.times(0.75), noise, implausible, doubtful) == "ambiguous"


def test_faults_found_before_count_as_causes():
    """`SIZE_PRIOR` 0.25, 0.69, 0.05 with the orders of a set: none given one is 0.69 to 2 * 0.05, not 0.25 to 0.69."""
    causes = np.arange(3)
    assert not given_found(causes, 0).any()
    assert given_found(causes, 1)[1] == pytest.approx(np.log(2 * 0.05 / 0.69) - np.log(0.69 / 0.25))
    assert given_found(causes, 2)[1] == pytest.approx(np.log(6 * 0.004 / 0.1) - np.log(0.69 / 0.25))
    # Beyond the largest set each further cause is as rare as its last.
    assert given_found(np.array([4]), 1) == pytest.approx(np.log(24 * 0.0003 / 0.024) - np.log(0.69 / 0.25))


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

    def term(u, where):
        return u[0] ** 2 + u[1] ** 2 - 2 * u[2] ** 2

    own = output_effect("mine.z", "z", term, unit="mg", typical=0.1, physics="", cause="")
    slots = [
        replace(NO_SLOT, id=effect.id, make=effect.make, columns=(0,))
        for effect in (own, ENTRIES["second_order.z"], ENTRIES["second_order.y"])
    ]
    assert one_function_at_1_g(slots[:1], slots[1:2]) and not one_function_at_1_g(slots[:1], slots[2:])
