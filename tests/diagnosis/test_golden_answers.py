"""The tools that compare versions of the diagnosis (`benchmarks/golden_answers.py`, `ablation.py`), on records made by hand."""

from copy import deepcopy
from types import SimpleNamespace

import pytest

from ablation import difference
from ablation_suspects import Replaced, Suspect, watched, without
from golden_compare import compared, report


ROW = {
    "name": "unit",
    "kind": "one d=7",
    "sha256": "0",
    "refused": "",
    "answer": {
        "verdict": "ambiguous",
        "causes": ["bias_drift.x"],
        "explanations": [
            {
                "effects": ["bias_drift.x"],
                "equivalents": [["bias_temperature.x"], ["outlier_position at 1-3"]],
                "probability": 0.9,
                "coefficients": {"bias_drift_x": {"value": 1.0, "sd": 0.1, "unit": "mg/h"}},
            },
            {
                "effects": ["outlier_position"],
                "positions": {"outlier_position": ["1-2"]},
                "equivalents": [],
                "probability": 0.1,
            },
        ],
        "parameters": {"dK_x": {"value": 1e-3, "u": 1e-4, "unit": "1"}, "gamma_21": {"value": 0.0, "u": None}},
    },
}


def changed(change):
    """What `compare` finds after a change of the row."""
    row = deepcopy(ROW)
    change(row)
    (found,) = compared({"unit": ROW}, {"unit": row})
    return list(found.lines)


def leading(row):
    return row["answer"]["explanations"][0]


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda row: None, []),
        (lambda row: row["answer"].update(verdict="identified"), ["verdict"]),
        (lambda row: row["answer"].update(causes=["bias_drift.y"]), ["class"]),
        (lambda row: leading(row)["equivalents"].pop(), ["class"]),
        (lambda row: leading(row)["equivalents"].reverse(), []),
        (lambda row: leading(row).update(probability=0.915), []),
        (lambda row: leading(row).update(probability=0.93), ["probability"]),
        (lambda row: row["answer"]["explanations"].pop(), ["probability"]),
        (lambda row: leading(row)["coefficients"]["bias_drift_x"].update(value=1.009), []),
        (lambda row: leading(row)["coefficients"]["bias_drift_x"].update(value=1.011), ["coefficient"]),
        (lambda row: row["answer"]["parameters"]["dK_x"].update(u=1.2e-4), ["coefficient"]),
        (lambda row: row["answer"]["parameters"]["gamma_21"].update(u=1.0), ["coefficient"]),
        (lambda row: row.update(answer=None, refused="unit.csv: too few"), ["refusal"]),
        (lambda row: row.update(sha256="1"), ["file"]),
    ],
)
def test_compare_lists_each_change(change, found):
    assert changed(change) == found


def test_report_counts_by_kind_and_names_files():
    other = deepcopy(ROW) | {"name": "other", "kind": "two d=8"}
    later = deepcopy(other)
    later["answer"]["verdict"] = "identified"
    text = report(compared({"unit": ROW, "other": other}, {"unit": ROW, "other": later}))
    assert "other (two d=8)\n    verdict: ambiguous -> identified" in text and "unit (" not in text
    assert text.splitlines()[-1].split() == ["all", "2", "0", "0", "0", "1", "0", "0", "0"]
    assert compared({"unit": ROW}, {})[0].lines == {"missing": ["only before"]}


def test_a_suspect_is_reached_where_its_replacement_differs():
    owner = SimpleNamespace(largest=max)
    suspect = Suspect("largest", (Replaced(owner, "largest", lambda *numbers: numbers[0], lambda a, b: a == b),), ())
    with watched([suspect]) as reached:
        assert owner.largest(3, 2) == 3 and not reached
        assert owner.largest(2, 3) == 3 and reached == {"largest"}
    with without(suspect):
        assert owner.largest(2, 3) == 2
    assert owner.largest is max


def test_difference_of_matched_pairs():
    # Worked by hand: b = 8.5, c = 2.5, n = 102; (c - b) / n and sqrt(b + c - (c - b)^2 / n) / n.
    middle, sd = -6 / 102, (11 - 36 / 102) ** 0.5 / 102
    assert difference(8, 2, 100) == pytest.approx((-0.06, middle - 1.96 * sd, middle + 1.96 * sd))
    assert difference(0, 0, 100)[1] == pytest.approx(-difference(0, 0, 100)[2])
