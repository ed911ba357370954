"""Words on units of one head and of a hand-held session, from records made by hand: each kind of finding is in one text."""

from types import SimpleNamespace as Record

import numpy as np

from tumblecal.diagnosis.units.record import level_sizes, spread_sizes
from tumblecal.effects import catalogue
from tumblecal.estimation.plausibility import Implausible
from tumblecal.show.units_together import words_of_units
from tumblecal.show.verdict import verdict_lines


ENTRIES = catalogue()
LEVEL, SQUARE, WOBBLE = "base_levelling", "second_order.y", "spindle_wobble_1"
# Base unit of each; the scales are those of the fit, whose coefficients are of order one.
UNITS = {LEVEL: "rad", SQUARE: "g/g^2", WOBBLE: "rad"}
ROWS = [(f"u{k}", {"file": f"u{k}.csv", "causes": "", "verdict": "adequate"}) for k in range(6)]


def signal(id, names=None):
    names = names or (id,)
    return Record(
        label=id,
        slot=Record(names=names),
        names_and_units=[(name, UNITS[id]) for name in names],
        scales=np.full(len(names), 1e-3),
    )


def explanation(*labels, probability=0.93, by_unit=(), head_by_unit=(), stated=(), single=True):
    shared = Record(labels=labels, stated=stated, single_name=single)
    return Record(shared=shared, probability=probability, by_unit=by_unit, head_by_unit=head_by_unit)


def pitch(p_value=None, common=False, alone=(), changed=None):
    return Record(p_value=p_value, common=common, alone=alone, changed=changed)


def amounts(id, shown_in, mean=0.8, names=None):
    own = signal(id, names)
    count = len(own.names_and_units)
    mean = (np.full(count, mean), np.full(count, 0.05))
    return Record(signal=own, mean=mean, tau=1.3, determined=np.arange(count) == 0, shown_in=shown_in)


def head(*sizes):
    """Errors of the head: name, value and standard uncertainty in rad."""
    names, values, sds = zip(*sizes, strict=True)
    return Record(names=names, units=("rad",) * len(names), values=np.array(values), sd=np.array(sds))


def found(verdict, best, *others, detected=True, shared=(), varying=(), of_head=None, settings=None, **more):
    """A joint diagnosis of six units."""
    own = {
        "hand_held": False,
        "verdict": verdict,
        "joint": Record(best=best, explanations=(best, *others), p_value=3e-9 if detected else 0.3, detected=detected),
        "fit": Record(
            excluded=more.pop("excluded", ()), pitch=settings or pitch(), head=of_head, consistent=(0.5,) * 6,
            unit_values=np.full((6, 1), 0.2e-3), unit_sd=np.full((6, 1), 0.03e-3),
        ),
        "batch": Record(units=(Record(at=Record(problem=Record(readings=(0.0,) * 24), model=Record(slots=()))),) * 6),
        "shared": shared,
        "amounts": {each.signal.label: each for each in varying},
    }  # fmt: skip
    lists = dict.fromkeys(("implausible", "levels", "unexplained", "nothing_of_their_own", "outlying"), ())
    return Record(**(own | lists | more))


def texts(cases):
    """The verdict of each case in lines."""
    return {
        title: "\n".join(verdict_lines(words_of_units(found, rows, ENTRIES).verdict))
        for title, (found, rows) in cases.items()
    }


def rows(**causes):
    return [(name, row | {"causes": causes.get(name, ""), "probability": 0.91}) for name, row in ROWS]


TWO_LEVELS = Record(
    signal=signal(LEVEL), first=3, p_value=2e-4, values=np.array([[0.3], [-0.2]]), sd=np.array([[0.01], [0.02]])
)
NOTHING = explanation(probability=0.97)


def test_each_finding_on_a_head_is_in_a_text(snapshot):
    common = head((LEVEL, 0.25e-3, 0.011e-3), ("dbeta@45", -1.2e-3, 0.03e-3))
    cases = {
        "one error and common pitch settings": (
            found(
                "identified", explanation(LEVEL), explanation(WOBBLE, probability=0.05, by_unit=(SQUARE,)),
                shared=(signal(LEVEL),), of_head=common, settings=pitch(0.4, True, alone=(5,)), outlying=(2, 5), excluded=(2,),
            ),
            rows(u1="second_order.y", u2="base_levelling"),
        ),
        "a class of errors": (
            found(
                "ambiguous", explanation(LEVEL, probability=0.6, stated=((WOBBLE,),), single=False), shared=(signal(LEVEL),),
                of_head=common, settings=pitch(1e-7), outlying=(4,),
            ),
            rows(),
        ),
        "no name": (
            found("unexplained", explanation("unexplained"), unexplained=("the spindle angle",), nothing_of_their_own=(0, 3)),
            rows(u0="index_gain", u3="fixture_flexure", u4="second_order.z"),
        ),
        "nothing": (found("adequate", NOTHING, detected=False), rows()),
        "two levels": (
            found(
                "identified", NOTHING, levels=(TWO_LEVELS,), varying=(amounts(LEVEL, ()),), settings=pitch(1e-6, changed=3),
                nothing_of_their_own=(0, 1),
            ),
            rows(u0="base_levelling", u4="base_levelling + second_order.y"),
        ),
        "differs between units": (
            found(
                "ambiguous", explanation(probability=0.7, by_unit=(WOBBLE, SQUARE), head_by_unit=(WOBBLE,)),
                varying=(amounts(WOBBLE, (), names=("w_cos", "w_sin")), amounts(SQUARE, (1, 4))),
            ),
            rows(),
        ),
        "in all units": (
            found(
                "adequate", explanation(by_unit=(SQUARE,)), detected=False, varying=(amounts(SQUARE, tuple(range(6))),),
                unexplained=("the time",),
            ),
            rows(),
        ),
        "too large": (
            found(
                "ambiguous", explanation(LEVEL), shared=(signal(LEVEL),), of_head=head((LEVEL, 0.11, 1e-5)),
                implausible=(Implausible(LEVEL, 110.0, 0.01, 17.0, "mrad", "no head has such an error"),),
            ),
            rows(),
        ),
    }  # fmt: skip
    snapshot("units", texts(cases))


def test_sizes_are_in_the_unit_of_the_catalogue():
    """0.8 and 1.3 of 1e-3 g/g^2, and levels of 0.3 and -0.2 mrad; the sine of the wobble is not determined separately."""
    several = found(
        "ambiguous",
        explanation(by_unit=(SQUARE, WOBBLE)),
        varying=(amounts(SQUARE, (1,)), amounts(WOBBLE, (), names=("w_cos", "w_sin")), amounts(LEVEL, ())),
        levels=(TWO_LEVELS,),
    )
    sizes = spread_sizes(several, ENTRIES)
    assert sizes[SQUARE][SQUARE].unit == "mg/g^2" and sizes[WOBBLE]["w_sin"].mean is None
    np.testing.assert_allclose([sizes[SQUARE][SQUARE].mean, sizes[SQUARE][SQUARE].mean_sd], [0.8, 0.05])
    np.testing.assert_allclose(sizes[WOBBLE]["w_cos"].sd_between_units, 1.3)
    (levels,) = level_sizes(several, ENTRIES, ROWS)
    assert [(part.first, part.last) for part in levels.parts] == [("u0", "u2"), ("u3", "u5")]
    np.testing.assert_allclose([part.coefficients[LEVEL].value for part in levels.parts], [0.3, -0.2])
