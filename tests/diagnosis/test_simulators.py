"""The simulators of benchmarks/ are what they say, and their judge is fair; the studies themselves are run by hand."""

import pytest

from blind.judge import Case, answer_of_record, judged


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
