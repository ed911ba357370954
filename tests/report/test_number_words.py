"""Words beside numbers never say what the numbers contradict."""

from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.diagnosis.priors import SURE
from tumblecal.ground.numbers_shown import capped, changed, p_words, rounded, rounded_together
from tumblecal.history.comparison import Moved
from tumblecal.report.budget_report import combined_table, contributions_table, intrinsic_table, monte_carlo_table
from tumblecal.report.cause_words import ambiguity
from tumblecal.report.history_words import comparison_text, trend_row
from tumblecal.report.paper_report import _published_table


@pytest.mark.parametrize("probability", [0.4, 0.6, SURE, 0.94, 0.999])
@pytest.mark.parametrize("alike", [True, False])
def test_equally_well_is_said_of_equals_alone(probability, alike):
    others = [(1.0 - probability) * share for share in (0.7, 0.3)]
    said = ambiguity(probability, others, indistinguishable=alike)
    assert ("almost equally well" in said) == (probability <= 2 * others[0])
    assert ("cannot be distinguished" in said) == (alike and probability >= SURE)


@pytest.mark.parametrize(
    ("value", "u", "words"),
    [
        (0.20149, 0.01346, "0.201 +- 0.013"),
        (-0.00004, 0.0996, "0.00 +- 0.10"),
        (1234.6, 123.4, "1230 +- 120"),
        (0.5321, 6.2, "0.5 +- 6.2"),
        (17.04, 57.0, "17 +- 57"),
        (1.5, 0.0, "1.5000 +- 0.0000"),
    ],
)
def test_uncertainties_have_two_digits_and_values_the_same_decimal(value, u, words):
    """GUM 7.2.6."""
    assert rounded_together(value, u) == words


def test_further_uncertainties_have_the_same_decimal():
    assert rounded(1.23456, 0.0123, 0.1999) == ["1.235", "0.012", "0.200"]


@pytest.mark.parametrize(
    ("before", "after", "u", "words"),
    [
        (0.2, 0.102, 0.014, "0.200 -> 0.102"), (0.2, 0.102, None, "0.200 -> 0.102"), (172.4, 128.1, 30.0, "172 -> 128"),
        (12.3, 0.0456, None, "12.3000 -> 0.0456"),
    ],
)  # fmt: skip
def test_a_change_has_equal_decimals(before, after, u, words):
    assert changed(before, after, u) == words


def test_no_number_pretends_precision():
    assert [p_words(p) for p in (0.6142, 0.0123, 3.21e-13, 0.0)] == ["p = 0.61", "p = 0.012", "p = 3e-13", "p < 1e-100"]
    assert [capped(x, "+.1f") for x in (12.34, -92.9, 1.6e6, -1.1e8)] == ["+12.3", "-92.9", "> 1000", "< -1000"]


def test_tables_of_results_have_two_digits_of_the_uncertainty_and_values_to_the_same_decimal(monkeypatch):
    """GUM 7.2.6, in mg: bias 1.23456 with u 0.0123 and U 0.0246; a drift of 0.05678 with u 0.0321 per month."""
    sizes = {"values": [0.0, 1.23456e-3], "sd": [1.23e-5] * 2, "expanded": [2.46e-5] * 2, "en": [0.51]}
    arrays = {name: np.array(values) for name, values in sizes.items()}
    trend = SimpleNamespace(name="bias_x", unit="g", drift=5.678e-5, drift_sd=3.21e-5, p_value=0.123, **arrays)
    assert trend_row(trend) == ["bias_x", "1.235", "0.025", "mg", "0.51", "0.057", "0.032", "0.12"]
    trend.sd, trend.drift, trend.drift_sd = np.zeros(2), np.nan, np.nan
    assert trend_row(trend) == ["bias_x", "1.2346", "", "mg", "0.51", "", "", "0.12"]
    comparison = SimpleNamespace(moved=[Moved("bias_x", "g", 1.23456e-3, 1.3e-3, 1.23e-5)], joint=[])
    assert comparison_text(comparison).splitlines()[1].split() == [
        "bias_x",
        "1.235",
        "1.300",
        "0.065",
        "0.012",
        "5.3",
        "mg",
    ]

    fit = SimpleNamespace(names=("bias_x",), values=[1.23456e-3], sd=[1.23e-5], units=["g"], shared=[0])
    budget = SimpleNamespace(
        fit=fit, names=fit.names, labels=("head",), sizes=np.array([[1.04e-5]]), type_a=np.array([6.57e-6]),
        combined=np.array([1.23e-5]), expanded=np.array([2.46e-5]), dof=[np.inf], coverage=[2.0],
        without=lambda k: np.array([[1.999e-5, 1.3e-5][k]]),
    )  # fmt: skip
    row = ["bias_x", "mg", "1.235", "0.0066", "0.010", "0.012", "inf", "2.00", "0.025", "head", "0.013"]
    assert combined_table(budget).rows == [row]
    assert contributions_table(budget).rows == [["bias_x", "mg", "0.0066", "0.010", "0.012"]]
    checked = SimpleNamespace(sd=[1.26e-5], half_width=[2.51e-5], within=[0.95])
    assert monte_carlo_table(budget, checked).rows == [["bias_x", "mg", "0.012", "0.013", "0.025", "0.025", "0.950"]]
    monkeypatch.setattr("tumblecal.report.budget_report._of_triad", lambda _: [("bias", 1.23456e-3, 1.23e-5, "g")])
    assert intrinsic_table(budget).rows == [["bias", "mg", "1.235", "0.012"]]
    monkeypatch.setattr("tumblecal.report.paper_report.paper.table2", lambda: {"bias_x": [1.2e-3, 1.25e-3, 0.0]})
    assert list(_published_table(fit).rows[0]) == ["bias_x", "mg", "1.200", "1.250", "0.000", "1.235", "0.012", "-2.8"]
