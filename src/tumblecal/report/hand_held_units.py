"""Units of a hand-held session in words: no dividing head is involved, so only effects of the sensors can be common to them."""

from collections.abc import Iterator

from tumblecal.diagnosis.head import Together
from tumblecal.effects import Catalogue
from tumblecal.report.head_amounts import UnitRows, shown_in, spread_sizes
from tumblecal.report.verdict import Finding, Verdict


# Said of every session.
ATTITUDES = (
    "No dividing head is involved, and no head.toml is written. Assumed: every unit has attitudes of its own, which holds "
    "for units held together on one fixture as well as one after the other."
)


def session(found: Together, units: int) -> str:
    """What was measured, as a title."""
    return f"{units} units, hand-held" if found.hand_held else f"{units} units on one head"


def hand_held_verdict(found: Together, units: UnitRows, entries: Catalogue) -> Verdict:
    """The effects that the units have in common and what is each unit's own."""
    sizes = spread_sizes(found, entries)
    lines = []
    for id, own in sizes.items():
        sizes_of_axes = "; ".join(
            f"{name} {_mean(size)}, sd between units {size['sd_between_units']:.2g} {size['unit']}"
            for name, size in own.items()
        )
        count = len(shown_in(found)[id])
        lines.append(f"{id} ({sizes_of_axes}), clear by itself in {count} of {len(units)} units. {entries[id].cause}")
    said = {"found": tuple(map(Finding, lines)), "evidence": (ATTITUDES, *_own(units))}
    return Verdict(found.verdict, _headline(units, list(sizes)), "", "", **said)


def _headline(units: UnitRows, common: list[str]) -> str:
    if common:
        return f"the {len(units)} units have in common {', '.join(common)}, each with its own coefficients."
    alone = [name for name, row in units if row.get("causes")]
    if alone:
        return f"no effect is common to the {len(units)} units; {len(alone)} of them have a cause of their own."
    return f"the {len(units)} units have no effect in common, and none contradicts the model."


def _mean(size: dict) -> str:
    if size["mean"] is None:
        return "of an undetermined mean"
    return f"{size['mean']:.2g} ± {size['mean_sd']:.1g} on average"


def _own(units: UnitRows) -> Iterator[str]:
    listed = [f"{name}: {row['causes']} ({row['probability']:.2f})" for name, row in units if row.get("causes")]
    if listed:
        yield f"By the units' own verdicts: {'; '.join(listed)}."
