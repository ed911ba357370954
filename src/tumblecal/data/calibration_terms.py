"""The nonlinear and thermal terms of a calibration file, checked."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from tumblecal.data.calibration_parts import is_number
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


KINDS = {"product": lambda value: value, "abs": np.abs, "sign": np.sign}


def checked(terms: object, named: str = "calibration") -> list[dict[str, Any]]:
    """The terms of a calibration file.

    **Arguments:**

    - `named`: what they are of, for faults: the file.

    **Raises:** `InputError`, one line for each key that is missing or is not what it may be.
    """
    if not isinstance(terms, list):
        raise InputError(f"{named}: terms: {shown(terms)} is not a list")
    faults = [f"{named}: terms.{number}{fault}" for number, term in enumerate(terms) for fault in _faults(term)]
    if faults:
        raise InputError(faults)
    return terms


def _are_powers(value: object) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(type(own) is int and 0 <= own <= 9 for own in value)


# What each key may be: told by a function, and in words.
_Rule = tuple[Callable[[object], bool], str]
_MUST: dict[str, _Rule] = {
    "axis": (lambda value: value in AXES, "one of 'x', 'y', 'z'"),
    "coefficient": (is_number, "a number (g)"),
    "powers": (_are_powers, "three whole numbers from 0 to 9, of the inputs along x, y and z"),
}
_MAY: dict[str, _Rule] = {
    "kind": (lambda value: isinstance(value, str) and value in KINDS, "one of 'product', 'abs', 'sign'"),
    "per_degc": (lambda value: isinstance(value, bool), "true or false"),
    "per_hour": (lambda value: isinstance(value, bool), "true or false"),
}
_WITH: dict[str, tuple[str, _Rule]] = {
    "per_degc": ("reference_degc", (is_number, "a number (degC), from which per_degc counts")),
    "per_hour": ("reference_s", (is_number, "a number (s), from which per_hour counts")),
}


def _faults(term: object) -> Iterator[str]:
    if not isinstance(term, dict):
        yield f": {shown(term)} is not an object"
        return
    rules = _MUST | {key: rule for key, rule in _MAY.items() if key in term}
    rules |= {reference: rule for key, (reference, rule) in _WITH.items() if term.get(key)}
    for key, (fits, allowed) in rules.items():
        if key not in term:
            yield f".{key} is missing; it must be {allowed}"
        elif not fits(term[key]):
            yield f".{key}: {shown(term[key])}; it must be {allowed}"
