"""The one layout of a verdict, from records made by hand: order of the blocks, number of lines, whole commands and sizes."""

from types import SimpleNamespace

import numpy as np

from tumblecal.diagnosis.findings.factors import Factor, Reason
from tumblecal.diagnosis.screening.noise_change import NoiseFault
from tumblecal.report.diagnosis_verdict import alternatives, headline, reason_words
from tumblecal.show.verdict import Finding, Unresolved, Verdict, verdict_lines


COMMAND = "tumblecal diagnose --join --same-run measured.csv next/positions.csv --noise-sd 0.1mg --gravity lat=48.14,height=520"
TWO = Verdict(
    "ambiguous",
    "Two errors found; the cause of one is not resolved.",
    "measured.csv",
    "yes, from 24 to 26.5 degC only",
    found=(
        Finding("Second-order nonlinearity of the z axis", "0.532 +- 0.062 mg/g^2", "second_order.z"),
        Finding("The bias of the x axis drifts", "0.297 +- 0.054 mg/h", "bias_drift.x"),
    ),
    unresolved=(Unresolved("bias_drift.x or bias_temperature.x", "time and temperature correlate (r = 1.00)", (2,)),),
    evidence=("Nominal model rejected, p = 3.2e-13.", "Held-out error 0.141 -> 0.103 mg."),
    next=("Measure next: alpha 0, 225 at beta 0.", COMMAND),
    details=(
        ("Not testable", "the data have no column approach: index_backlash."),
        ("Not testable", "the data have only one run: bias_repeatability."),
    ),
)


def labels(lines) -> list[str]:
    return [line.split()[0] for line in lines if line[:1].strip()]


def test_at_most_25_lines_stand_above_the_rule_and_nothing_is_lost():
    words = [
        f"word{k} " + "of an entry that is longer than a line of this layout is at its hundred columns " * 2
        for k in range(40)
    ]
    many = Verdict(
        "unexplained", words[0], "a.csv", f"no: {words[1] * 2}",
        found=tuple(map(Finding, words[2:12])), unresolved=tuple(map(Unresolved, words[12:20])),
        evidence=tuple(words[20:28]), next=(COMMAND, *words[28:]),
    )  # fmt: skip
    lines = verdict_lines(many)
    above = lines.index("-" * 100)
    assert above <= 25 and labels(lines[:above]) == ["UNEXPLAINED", "USE", "FOUND", "UNRESOLVED", "EVIDENCE", "NEXT"]
    assert max(len(line) for line in lines if "tumblecal" not in line) <= 100
    printed = " ".join(" ".join(lines).split())
    assert all(" ".join(entry.split()) in printed for entry in (words[5], words[15], words[25], words[39], COMMAND))
    assert all(f"word{k} " in printed for k in range(40))
    # A heading is printed once, for whatever number of entries, at every width.
    for width in (60, 100):
        assert sum("NEXT, continued" in line for line in verdict_lines(many, width)) == 1


def test_alternatives_of_one_reason_are_one_line():
    clocks, identity = Reason("columns", ("time_s", "temperature_degc"), 0.9999), Reason("identity")
    members = (("bias_drift.x",), ("bias_temperature.x",), ("warm_up",), ("bias_temperature_square.x",))
    factor = Factor(members, (clocks, Reason("angles"), clocks._replace(r=0.9991)))
    time, angles = alternatives(factor, {"second_order.z": 1, "bias_drift.x": 2})
    assert time.sentence == (
        "2. bias_drift.x or bias_temperature.x or bias_temperature_square.x: time and temperature are fully correlated in "
        "these data (r = 1.00)"
    )
    assert angles.sentence == "2. bias_drift.x or warm_up: the same signal at these angles"
    square = Factor((("second_order.z",), ("cross_axis_square.z",)), (identity,))
    (words,) = [one.sentence for one in alternatives(square, {"second_order.z": 1})]
    assert words.startswith("1. second_order.z or cross_axis_square.z: the same function in a 1 g field")
    for kind in ("size", "angles", "unnamed", "identity"):
        assert reason_words(Reason(kind))
    assert reason_words(Reason("range", ("temperature_degc",))) == "temperature does not vary enough in these data"


DOUBTED = {"noise_level": NoiseFault("every sd times 3", "unexplained")}


def diagnosed(verdict="ambiguous", labels=("bias_drift.x", "second_order.z"), probability=0.97, **changed):
    """As much of a diagnosis as a headline needs."""
    best = SimpleNamespace(labels=labels, probability=probability, single_name=verdict == "identified")
    other = SimpleNamespace(probability=0.02)
    screened = SimpleNamespace(detection=SimpleNamespace(p_value=3.2e-13), explanations=[best, other])
    given = {"setup_errors": (), "noise_labels": (), "implausible": (), "located": [], "level": 1.0, "data": range(24)}
    problem = SimpleNamespace(sd=np.full((24, 3), 1e-4))
    return SimpleNamespace(verdict=verdict, best=best, screened=screened, problem=problem, **given | changed)


HEADLINES = {
    "adequate": (diagnosed("adequate", ()), 0, 0),
    "identified": (diagnosed("identified", ("a.x",)), 1, 0),
    "one of two open": (diagnosed(), 2, 1),
    "both open": (diagnosed(), 2, 2),
    "one and open": (diagnosed(labels=("a.x",)), 1, 1),
    "unexplained": (diagnosed("unexplained"), 1, 0),
    "noise": (diagnosed("identified", (), noise_labels=("noise_unequal",)), 1, 0),
    "noise, not sure": (
        diagnosed("ambiguous", (), noise_labels=("noise_level",), noise_wrong={}, probability=0.6), 1, 0,
    ),
    "noise or no entry": (diagnosed("ambiguous", (), noise_labels=("noise_level",), noise_wrong=DOUBTED), 1, 0),
    "implausible": (diagnosed("unexplained", (), implausible=(SimpleNamespace(stated=None),)), 1, 0),
}  # fmt: skip


def test_layout_and_headlines(snapshot):
    texts = {"layout": "\n".join(verdict_lines(TWO)), "without layout": TWO.words()}
    snapshot("verdict", texts | {title: headline(*own) for title, own in HEADLINES.items()})
