"""The one layout of a verdict, from records made by hand: order of the blocks, number of lines, whole commands and sizes."""

from dataclasses import replace
from types import SimpleNamespace

from tumblecal.diagnosis.causes.cause import EFFECT, Cause, id_of, label_words
from tumblecal.diagnosis.coefficients import Coefficient
from tumblecal.diagnosis.findings.factors import Factor, Reason
from tumblecal.diagnosis.screening.noise_change import NoiseFault
from tumblecal.effects import catalogue
from tumblecal.estimation.identifiability import formula
from tumblecal.show.diagnosis import alternatives
from tumblecal.show.verdict import Finding, Unresolved, Verdict, verdict_lines
from tumblecal.show.words import words_of


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


CLOCKS = Reason("columns", ("time_s", "temperature_degc"), 0.9999)
MEMBERS = (("bias_drift.x",), ("bias_temperature.x",), ("warm_up",), ("bias_temperature_square.x",))
FACTORS = [
    Factor((("second_order.z",), ("cross_axis_square.z",)), (Reason("identity"),)),
    Factor(MEMBERS, (CLOCKS, Reason("angles"), CLOCKS._replace(r=0.9991))),
]
FACTORS += [
    Factor((("a",), ("b",)), (one,)) for one in (Reason("size"), Reason("unnamed"), Reason("range", ("pitch",)))
]
SLOPE, SQUARE = Coefficient({"a": 1.0}, 0.5, 0.1, "mg/degC"), Coefficient({"b": 1.0}, 4.0, 0.2, "ug/degC^2")


def finding(*labels, sizes=(SLOPE, SQUARE), reference=None):
    entries = [catalogue()[id_of(label)] for label in labels]
    slots = [SimpleNamespace(polynomial=entry.polynomial[0], order=entry.polynomial[1]) for entry in entries]
    causes = [Cause(EFFECT, label, 0.0, 0.0, slot=slot) for label, slot in zip(labels, slots, strict=True)]
    return {"number": 1, "causes": causes, "sizes": sizes, "reference": reference}


FINDINGS = [
    finding("bias_temperature.x", "bias_temperature_square.x", reference=25.0),
    finding("second_order.z", "third_order.z"),
    finding("index_zero", sizes=[replace(SLOPE, weights={"c": 1.0, "d": -0.5}), replace(SQUARE, sd=None)]),
    finding("outlier_position:p1+p4", sizes=()),
]
DOUBTED, OPEN = {"noise_level": NoiseFault("every sd times 3", "unexplained")}, SimpleNamespace(resolved=False)


def diagnosed(verdict="ambiguous", labels=("bias_drift.x", "second_order.z"), probability=0.97, factors=(), **changed):
    """As much of a diagnosis as a headline needs."""
    best, other = SimpleNamespace(labels=labels, probability=probability), SimpleNamespace(probability=0.02)
    screened = SimpleNamespace(detection=SimpleNamespace(p_value=3.2e-13))
    given = {"setup_errors": (), "noise_labels": (), "implausible": (), "located": [], "data": range(24)}
    given |= {"factors": factors, "leading": lambda least, most: [best, other]}
    return SimpleNamespace(verdict=verdict, best=best, screened=screened, **given | changed)


HEADLINES = {
    "adequate": (diagnosed("adequate", ()), 0),
    "identified": (diagnosed("identified", ("a.x",)), 1),
    "one of two open": (diagnosed(factors=[OPEN]), 2),
    "both open": (diagnosed(factors=[OPEN, OPEN]), 2),
    "one and open": (diagnosed(labels=("a.x",), factors=[OPEN]), 1),
    "unexplained": (diagnosed("unexplained"), 1),
    "noise": (diagnosed("identified", (), noise_labels=("noise_unequal",)), 1),
    "noise, not sure": (diagnosed(labels=(), noise_labels=("noise_level",), noise_wrong={}, probability=0.6), 1),
    "noise or no entry": (diagnosed("ambiguous", (), noise_labels=("noise_level",), noise_wrong=DOUBTED), 1),
    "not sure": (diagnosed(probability=0.6), 2),
    "equally probable": (diagnosed(probability=0.03), 2),
    "implausible": (diagnosed("unexplained", (), implausible=(SimpleNamespace(stated=None),)), 1),
}  # fmt: skip


def test_layout_and_headlines(snapshot):
    texts = {"layout": "\n".join(verdict_lines(TWO)), "without layout": TWO.words()}
    nothing = {"setup_errors": (), "noise_wrong": {}, "unnamed": None, "members": (), "located": ()}
    others = {"unusual": (), "law": None, "dead_zone": False, "patchwork": False, "identity": ""}
    best = SimpleNamespace(unexplained=False, less_probable=())
    words = words_of(
        "diagnosis_found", d=SimpleNamespace(best=best, verdict="ambiguous", entries=catalogue(), **nothing),
        findings=FINDINGS, alternatives=list(alternatives(FACTORS, {"second_order.z": 1, "bias_drift.x": 2})),
        title=str, formula=formula, label_words=label_words, **others,
    )  # fmt: skip
    verdict = words.verdict
    texts["found"] = "\n".join(one.sentence for one in (*verdict.found, *verdict.unresolved))
    for title, (diagnosis, count) in HEADLINES.items():
        texts[title] = words_of("diagnosis_headline", d=diagnosis, count=count, noise_mg=0.1).text("headline")
    snapshot("verdict", texts)
