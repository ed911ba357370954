"""The diagnosis of Table 1 as a part of the study's page: the verdict, and what these 72 numbers could not have shown."""

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.verdict import verdict_text
from tumblecal.report.page import PageTable, Section


def diagnosis_section(found: Diagnosis) -> Section:
    """Verdict, detection limits of the visible effects, and the harm of the invisible ones."""
    return Section(
        "Diagnosis of Table 1",
        words=[*verdict_text(found).splitlines(), "What these positions could and could not have shown:"],
        tables=[_limits(found), _invisible(found)],
    )


def _limits(found: Diagnosis) -> PageTable:
    rows = [
        [id, coefficient, "not visible" if size is None else f"{size:.3g}", limit.unit, f"{limit.visible_fraction:.0%}"]
        for id, limit in found.limits.items()
        for coefficient, size in limit.coefficients.items()
    ]
    header = ["effect", "coefficient", "limit (80 % power)", "unit", "visible"]
    return PageTable(header, rows)


def _invisible(found: Diagnosis) -> PageTable:
    rows = []
    for id, one in found.invisible.items():
        direction = " ".join(f"{share:+.2f} {name}" for name, share in one.direction.items())
        rows.append([id, direction, f"{one.size:g} {one.unit}", ", ".join(one.absorbed_by)])
    return PageTable(["invisible effect", "direction", "a size met in practice", "absorbed by"], rows)
