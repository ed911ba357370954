"""Temperature and time for which the stated values are valid, if the fitted model depends on them."""

from collections.abc import Sequence

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.ground.axes import AXES
from tumblecal.ground.units import in_words, shown


_POWERS = {1: "", 2: " squared", 3: " cubed"}


def validity_words(calibration: Calibration, *, judged: bool, temperatures_degc: Sequence[float] = ()) -> str:
    """The validity in words; "" if no parameter or term depends on temperature or time.

    **Arguments:**

    - `judged`: with a statement of conformity. `temperatures_degc`: of the values of parameters that follow temperature.
    """
    stated = "The values, and the statement of conformity," if judged else "The values"
    return " ".join(filter(None, [_of_curves(calibration, stated, temperatures_degc), _of_terms(calibration, stated)]))


def _of_curves(calibration: Calibration, stated: str, temperatures_degc: Sequence[float]) -> str:
    if calibration.temperature is None:
        return ""
    places = [f"{degc:.4g}" for degc in temperatures_degc or [calibration.temperature.reference_degc]]
    listed = f"{', '.join(places[:-1])} and {places[-1]}" if len(places) > 1 else places[0]
    names = ", ".join(curve.parameter for curve in calibration.temperature.curves if curve.functions.count)
    return (
        f"{stated} are valid at {listed} degC: {names or 'no parameter'} changes with temperature, measured from "
        f"{calibration.temperature.range_words}."
    )


def _of_terms(calibration: Calibration, stated: str) -> str:
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
    span = calibration.provenance.get("temperature_range_degc")
    within = f" (the data: {span[0]:.3g} to {span[1]:.3g} degC)" if span else ""
    return f"{stated} are valid at {' and '.join(places)}: {', '.join(changes)}{within}."


def _change(term: Term, per: str) -> str:
    """The change due to a term: size for a bias or a scale factor error, otherwise the readings of its axis."""
    alone = tuple(int(other == term.axis) for other in AXES)
    if term.kind == "product" and term.powers in ((0, 0, 0), alone):
        name, unit = (f"dK_{term.axis}", "1") if any(term.powers) else (f"bias_{term.axis}", "g")
        printed, factor = shown(unit)
        return f"{name} changes by {in_words(format(term.coefficient * factor, '.3g'), printed)} {per}"
    return f"the readings of axis {term.axis} change ({term.effect or 'a term'}) {per}"
