"""Temperature and time for which the stated values are valid, if the fitted model depends on them."""

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.ground.axes import AXES
from tumblecal.ground.units import in_words, shown


_POWERS = {1: "", 2: " squared", 3: " cubed"}


def validity_words(calibration: Calibration, *, judged: bool) -> str:
    """The validity in words; "" if no term depends on temperature or time. `judged`: with a statement of conformity."""
    thermal = [term for term in calibration.terms if term.thermal]
    drifting = [term for term in calibration.terms if term.per_hour]
    places = [
        *dict.fromkeys(f"{term.reference_degc:g} degC" for term in thermal),
        *dict.fromkeys(f"time_s = {term.reference_s:g} s" for term in drifting),
    ]
    changes = [_change(term, f"per degC{_POWERS.get(term.degc_power, f'^{term.degc_power}')}") for term in thermal]
    changes += [_change(term, "per hour") for term in drifting]
    if not places:
        return ""
    match calibration.provenance.get("temperature_range_degc"):
        case [float() | int() as low, float() | int() as high]:
            within = f" (the data: {low:.3g} to {high:.3g} degC)"
        case _:
            within = ""
    stated = "The values, and the statement of conformity," if judged else "The values"
    return f"{stated} are valid at {' and '.join(places)}: {', '.join(changes)}{within}."


def _change(term: Term, per: str) -> str:
    """The change due to a term: size for a bias or a scale factor error, otherwise the readings of its axis."""
    alone = tuple(int(other == term.axis) for other in AXES)
    if term.kind == "product" and term.powers in ((0, 0, 0), alone):
        name, unit = (f"dK_{term.axis}", "1") if any(term.powers) else (f"bias_{term.axis}", "g")
        printed, factor = shown(unit)
        return f"{name} changes by {in_words(format(term.coefficient * factor, '.3g'), printed)} {per}"
    return f"the readings of axis {term.axis} change ({term.effect or 'a term'}) {per}"
