"""At which temperature and time the stated values hold, where the fitted model has them change with either."""

from collections.abc import Iterator
from typing import Any

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import checked
from tumblecal.ground.axes import AXES
from tumblecal.ground.units import in_words, shown


# The key of a term that changes so, where it counts from, and both in words.
_CHANGES = (("per_degc", "reference_degc", "{:g} degC", "degC"), ("per_hour", "reference_s", "time_s = {:g} s", "hour"))


def holds_at(calibration: Calibration, *, judged: bool) -> str:
    """In words; empty where no term changes with temperature or time. `judged`: whether a statement of conformity is made."""
    terms = checked(calibration.extra.get("terms", []))
    places, changes = list[str](), list[str]()
    for key, reference, place, per in _CHANGES:
        own = [term for term in terms if term.get(key)]
        places += dict.fromkeys(place.format(term[reference]) for term in own)
        changes += (f"{words} per {per}" for words in _changes(own))
    if not places:
        return ""
    match calibration.provenance.get("temperature_range_degc"):
        case [float() | int() as low, float() | int() as high]:
            within = f" (the data: {low:.3g} to {high:.3g} degC)"
        case _:
            within = ""
    stated = "The values, and the statement of conformity," if judged else "The values"
    return f"{stated} hold at {' and '.join(places)}: {', '.join(changes)}{within}."


def _changes(terms: list[dict[str, Any]]) -> Iterator[str]:
    """What each of these terms changes: a bias or a scale factor error by how much, else the readings of its axis."""
    for term in terms:
        axis, powers = term["axis"], list(term["powers"])
        alone = [int(other == axis) for other in AXES]
        if term.get("kind", "product") == "product" and powers in ([0, 0, 0], alone):
            name, unit = (f"dK_{axis}", "1") if any(powers) else (f"bias_{axis}", "g")
            printed, factor = shown(unit)
            yield f"{name} changes by {in_words(format(term['coefficient'] * factor, '.3g'), printed)}"
        else:
            yield f"the readings of axis {axis} change ({term.get('effect', 'a term')})"
