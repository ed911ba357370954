"""The stress study of benchmarks/: its cases are what they say, and its judge is fair. The study itself is run by hand."""

import numpy as np
import pytest

from blind_conditions import CONDITIONS, drawn, write
from blind_judge import Case, judged
from blind_stress import answer_of_record
from tumblecal.data import read_positions


@pytest.mark.parametrize(
    "name",
    [
        "one, d = 1000",
        "two, d = 8",
        "0.2 g bias, one d = 8",
        "soak at 85 degC, thermal d = 8",
        "2 outlier(s), one d = 8",
        "swap",
        "plan twice in two runs, u_x u_y^2",
        "unlisted: knee of an output, d = 10",
        "mistake: settings exchanged",
    ],
)
def test_conditions_are_what_they_say(tmp_path, name):
    condition, rng = CONDITIONS[name], np.random.default_rng(7)
    for _ in range(2):
        case = drawn(name, rng)
        write(tmp_path / "unit.csv", case.data)
        data = read_positions(tmp_path / "unit.csv", check_size=False)
        assert (data.sd is not None) == case.known and len(data.runs) == 1 + ("two runs" in name)
        unlisted, slip = condition.unlisted is not None, bool(condition.mistake)
        assert len(case.accepted[0]) == len(condition.sizes) + condition.outliers + condition.swap + slip
        assert (case.accepted[0] == ("unexplained",)) == unlisted
        if "85" in name:
            assert abs(np.mean(data.temperature_degc) - 85) < 5
        if "bias" in name:
            assert 0.05 < np.max(np.abs(np.linalg.norm(data.readings, axis=1) - 1)) < 0.4


def case_of(condition, *accepted):
    return Case(condition, 0, "3x8", True, accepted, {}, refusal="mistake" in condition)


def record_of(causes, equivalents=(), probability=0.95, verdict="identified", set_up=(), rivals=None):
    best = {"equivalents": list(equivalents), "probability": probability}
    return {
        "causes": causes,
        "verdict": verdict,
        "explanations": [best],
        "text": verdict.upper(),
        "set_up": list(set_up),
        "noise_rivals": rivals or {},
    }


SLIP = {"id": "pitch_reversed", "words": "", "equal": [{"id": "settings_exchanged", "words": ""}]}
OTHER_END = record_of(["pitch_reversed"], set_up=[SLIP])
# Condition, accepted, the answer, whether it is right, strict, wrong.
JUDGED = [
    ("nothing", [()], record_of([], verdict="adequate"), True, True, False),
    ("nothing", [()], record_of(["gravity_value"]), False, False, True),
    ("one, d = 10", [("a",)], record_of(["a"]), True, True, False),
    ("one, d = 10", [("a",)], record_of(["a", "noise_unequal"]), False, False, True),
    ("one, d = 10", [("a",)], record_of(["b"], [["a"]]), True, False, False),
    ("one, d = 10", [("a",)], record_of(["b"], [["c"]]), False, False, False),
    ("one, d = 10", [("a",)], record_of(["b"], probability=0.85), False, False, False),
    ("1 outlier(s)", [("outlier_position:1-2",)], record_of(["b"], [["outlier_position at 1-2"]]), True, False, False),
    ("unlisted: cable pull, d = 10", [("unexplained",)], record_of(["a"], [["unexplained"]]), True, False, False),
    ("unlisted: cable pull, d = 10", [("unexplained",)], record_of(["a"]), False, False, True),
    ("unlisted: cable pull, d = 10", [("unexplained",)], record_of(["n"], rivals={"n": "unexplained"}), True, False, False),
    ("unlisted: cable pull, d = 10", [("unexplained",)], record_of(["n"], rivals={"n": "noise_a"}), False, False, False),
    ("unlisted: cable pull, d = 10", [("unexplained",)], record_of(["unexplained", "noise_heavy_tail"]), False, False, False),
    ("mistake: settings exchanged", [("settings_exchanged",)], OTHER_END, True, False, False),
    ("mistake: settings exchanged", [("settings_exchanged",)], record_of([], verdict="adequate"), False, False, False),
    ("mistake: dead axis", [], None, True, True, False),
    ("one, d = 10", [("a",)], None, False, False, False),
]  # fmt: skip


@pytest.mark.parametrize(("condition", "accepted", "record", "right", "strict", "wrong"), JUDGED)
def test_the_judge(condition, accepted, record, right, strict, wrong):
    verdict = judged(case_of(condition, *accepted), answer_of_record(record, "" if record else "refused in words"))
    assert (verdict.right, verdict.strict, verdict.wrong) == (right, strict, wrong)


def test_a_traceback_is_no_refusal():
    verdict = judged(case_of("mistake: dead axis"), answer_of_record(None, "crash (1): LinAlgError"))
    assert verdict.crashed and not verdict.right
