"""Units of a hand-held session in words. Without a dividing head only effects of the sensors can be common to them."""

from collections.abc import Iterator

from tumblecal.diagnosis.head import Together
from tumblecal.effects import Catalogue
from tumblecal.report.head_amounts import UnitRows, between_units_words, shown_in, spread_sizes
from tumblecal.report.verdict import Finding, Verdict


ATTITUDES = (
    "No dividing head is involved, and no head.toml is written. Assumed: the attitudes of the units are independent; this is "
    "correct for units on one fixture and for units measured one after the other."
)


def session(found: Together, units: int) -> str:
    """The session as a title."""
    return f"{units} units, hand-held" if found.hand_held else f"{units} units on one head"


def hand_held_verdict(found: Together, units: UnitRows, entries: Catalogue) -> Verdict:
    """The effects that the units have in common, and the causes of single units."""
    sizes = spread_sizes(found, entries)
    lines = []
    for id, of_effect in sizes.items():
        listed = "; ".join(between_units_words(name, size) for name, size in of_effect.items())
        count = len(shown_in(found)[id])
        lines.append(f"{id} ({listed}), significant in {count} of {len(units)} units alone. {entries[id].cause}")
    evidence = (ATTITUDES, *_single_units(units))
    return Verdict(
        found.verdict, _headline(units, list(sizes)), "", "", found=tuple(map(Finding, lines)), evidence=evidence
    )


def _headline(units: UnitRows, common: list[str]) -> str:
    if common:
        return f"the {len(units)} units have in common {', '.join(common)}, with different coefficients."
    alone = [name for name, row in units if row.get("causes")]
    if alone:
        return f"no effect is common to the {len(units)} units; {len(alone)} of them have individual causes."
    return f"the {len(units)} units have no effect in common, and all are consistent with the nominal model."


def _single_units(units: UnitRows) -> Iterator[str]:
    listed = [f"{name}: {row['causes']} ({row['probability']:.2f})" for name, row in units if row.get("causes")]
    if listed:
        yield f"Causes of individual units: {'; '.join(listed)}."
