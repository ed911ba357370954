"""`use` of a calibration file: read, written, in words, and rejected where it is not understood."""

import json

import numpy as np
import pytest

from tumblecal import InputError
from tumblecal.data.calibration import Calibration, read_calibration, write_calibration
from tumblecal.data.calibration_use import Use, combined


SAID = [
    (
        Use("yes", expanded_g=0.00021),
        {"answer": "yes", "reason": "", "expanded_g": 0.00021},
        "yes, U = 0.21 mg (k = 2) of a corrected reading at any attitude",
    ),
    (
        Use("within", "a drift with temperature cannot be excluded", (24.0, 26.5)),
        {"answer": "within", "reason": "a drift with temperature cannot be excluded", "temperature_degc": [24.0, 26.5]},
        "yes, from 24 to 26.5 degC only: a drift with temperature cannot be excluded",
    ),
    (
        Use("not tested", "15 readings for 15 parameters", expanded_g=0.0008),
        {"answer": "not tested", "reason": "15 readings for 15 parameters", "expanded_g": 0.0008},
        "not tested: 15 readings for 15 parameters",
    ),
    (
        Use("only", "others are not determined", parameters=("bias_y", "dK_y")),
        {"answer": "only", "reason": "others are not determined", "parameters": ["bias_y", "dK_y"]},
        "only for bias_y, dK_y: others are not determined",
    ),
    (
        Use("no", "unexplained", expanded_g=0.0008),
        {"answer": "no", "reason": "unexplained", "expanded_g": 0.0008},
        "no: unexplained",
    ),
]


def plain(**more) -> Calibration:
    return Calibration(np.eye(3), np.zeros(3), np.zeros((12, 12)), **more)


@pytest.mark.parametrize(("use", "record", "words"), SAID, ids=[words for *_, words in SAID])
def test_use_is_kept_and_shown(tmp_path, use, record, words):
    path = tmp_path / "calibration.json"
    write_calibration(path, plain(use=use))
    assert json.loads(path.read_text())["use"] == record
    back = read_calibration(path)
    assert back.use == use and back.use.words == words and f"use: {words}" in repr(back)
    assert "use" not in back.extra


def test_no_is_rejected_unless_the_user_insists():
    bad = Use("no", "two rows exchanged")
    with pytest.raises(InputError, match=r"c\.json: use: no: two rows exchanged.*--use-anyway"):
        bad.require("c.json", anyway=False)
    bad.require("c.json", anyway=True)
    Use("within", "", (1.0, 2.0)).require("c.json", anyway=False)
    untested = Use("not tested", "no degree of freedom")
    untested.require("c.json", anyway=False)
    with pytest.raises(InputError, match=r"not tested: no degree of freedom\. Repeat the .*; --use-anyway"):
        untested.require("c.json", anyway=False, tested=True)


def test_the_strictest_of_several_findings_decides():
    warm, lost = Use("within", "range", (20.0, 30.0)), Use("yes", "a drift of 0.3 mg")
    some, no = Use("only", "part", parameters=("bias_x", "dK_x")), Use("no", "exchanged rows")
    untested = Use("not tested", "no degree of freedom")
    assert combined([Use("yes"), Use("yes", "noted")]) == Use("yes", "noted")
    assert combined([lost, warm], 3e-4) == Use("within", "a drift of 0.3 mg; range", (20.0, 30.0), (), 3e-4)
    both = combined([warm, lost, some])
    assert (both.answer, both.temperature_degc, both.expanded_g) == ("only", (20.0, 30.0), None)
    assert combined([some, untested, warm]).answer == "not tested"
    assert combined([warm, some, untested, no]).answer == "no" and combined([warm, no]).reason == "exchanged rows"
    assert combined([warm, Use("within", "other", (40.0, 50.0))]).answer == "no"
