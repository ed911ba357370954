"""The terms of a calibration file, in addition to matrix and bias: of any order in the inputs and the temperature.

A term adds `coefficient * kind(u_x^i u_y^j u_z^k) * (T - reference_degc)^degc_power * hours` to the reading of one axis.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration_parts import is_number
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


KINDS = {"product": lambda value: value, "abs": np.abs, "sign": np.sign}
_HIGHEST = 9


@dataclass(frozen=True)
class Term:
    """One term of a calibration.

    - `axis`: of the output. `coefficient`: g, degC, h. `powers`: of the inputs along x, y and z. `kind`: `product`, or `abs` or
      `sign` of that product.
    - `degc_power`: power of the temperature less `reference_degc`; 0: independent of the temperature.
    - `per_hour`: whether it is multiplied by the hours since `reference_s`.
    - `effect`: id of the catalogue entry, "" if not stated. `determined`: whether the data determined it separately.
    """

    axis: str
    coefficient: float
    powers: tuple[int, int, int] = (0, 0, 0)
    kind: str = "product"
    degc_power: int = 0
    reference_degc: float = 0.0
    per_hour: bool = False
    reference_s: float = 0.0
    effect: str = ""
    determined: bool = True

    @property
    def thermal(self) -> bool:
        """Whether it changes with the temperature."""
        return self.degc_power > 0

    @property
    def of_bias(self) -> bool:
        """Whether it does not depend on the inputs."""
        return not any(self.powers) and self.kind != "sign"

    def of_inputs(self, inputs: Float[np.ndarray, "rows 3"]) -> np.ndarray:
        """The factor of the inputs (g) for each row; one value for all rows if the term does not depend on them."""
        powers = [inputs[:, k] for k, power in enumerate(self.powers) for _ in range(power)]
        return KINDS[self.kind](reduce(np.multiply, powers) if powers else np.ones(1))

    def factor(self, temperature_degc: np.ndarray | None, time_s: np.ndarray | None) -> np.ndarray | float:
        """The coefficient times the factors of temperature and time, for each row; a None has no influence."""
        factor: np.ndarray | float = self.coefficient
        if self.degc_power and temperature_degc is not None:
            factor = factor * (np.asarray(temperature_degc, float) - self.reference_degc) ** self.degc_power
        if self.per_hour and time_s is not None:
            factor = factor * ((np.asarray(time_s, float) - self.reference_s) / 3600)
        return factor

    def record(self) -> dict[str, Any]:
        """The record in a calibration file."""
        record: dict[str, Any] = {"axis": self.axis, "coefficient": self.coefficient, "powers": list(self.powers)}
        if self.kind != "product":
            record["kind"] = self.kind
        if self.degc_power:
            # `per_degc` is the form of all versions for a power of one.
            power = {"per_degc": True} if self.degc_power == 1 else {"degc_power": self.degc_power}
            record |= power | {"reference_degc": self.reference_degc}
        if self.per_hour:
            record |= {"per_hour": True, "reference_s": self.reference_s}
        return record | ({"determined": self.determined, "effect": self.effect} if self.effect else {})


def terms_of(stated: object, named: str = "calibration") -> tuple[Term, ...]:
    """The terms that a calibration file states.

    **Arguments:**

    - `named`: the file, for faults.

    **Raises:** `InputError`, one line for each key that is missing, unknown, or is not what it may be.
    """
    if not isinstance(stated, list):
        raise InputError(f"{named}: terms: {shown(stated)} is not a list")
    faults = [f"{named}: terms.{number}{fault}" for number, term in enumerate(stated) for fault in _faults(term)]
    if faults:
        raise InputError(faults)
    return tuple([_term(term) for term in stated])


def undetermined_words(terms: Sequence[Term]) -> str:
    """Words on terms that the data determine only in combination; "" if they determine each separately."""
    ids = dict.fromkeys(term.effect or f"a term of axis {term.axis}" for term in terms if not term.determined)
    if not ids:
        return ""
    return f"not determined separately, so the correction is valid near 1 g: {', '.join(ids)}"


def _term(stated: dict[str, Any]) -> Term:
    values = {key: value for key, value in stated.items() if key not in ("per_degc", "powers")}
    power = stated.get("degc_power", int(stated.get("per_degc", False)))
    i, j, k = stated["powers"]
    return Term(**values | {"powers": (i, j, k), "degc_power": power})


def _are_powers(value: object) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(_is_power(power) for power in value)


def _is_power(value: object) -> bool:
    return type(value) is int and 0 <= value <= _HIGHEST


# Condition of each key, as a function and in words.
_Rule = tuple[Callable[[object], bool], str]
_FLAG: _Rule = (lambda value: isinstance(value, bool), "true or false")
_MUST: dict[str, _Rule] = {
    "axis": (lambda value: value in AXES, "one of 'x', 'y', 'z'"),
    "coefficient": (is_number, "a number (g)"),
    "powers": (_are_powers, f"three whole numbers from 0 to {_HIGHEST}, of the inputs along x, y and z"),
}
_MAY: dict[str, _Rule] = {
    "kind": (lambda value: isinstance(value, str) and value in KINDS, "one of 'product', 'abs', 'sign'"),
    "per_degc": _FLAG,
    "degc_power": (_is_power, f"a whole number from 0 to {_HIGHEST}, the power of the temperature"),
    "per_hour": _FLAG,
    "reference_degc": (is_number, "a number (degC), from which the temperature counts"),
    "reference_s": (is_number, "a number (s), from which per_hour counts"),
    "effect": (lambda value: isinstance(value, str), "text"),
    "determined": _FLAG,
}
# What a key that is not false or zero needs as well.
_WITH = {"per_degc": "reference_degc", "degc_power": "reference_degc", "per_hour": "reference_s"}


def _faults(term: object) -> Iterator[str]:
    if not isinstance(term, dict):
        yield f": {shown(term)} is not an object"
        return
    needed = {_WITH[key] for key in _WITH if term.get(key)}
    rules = _MUST | {key: rule for key, rule in _MAY.items() if key in term or key in needed}
    for key, (fits, allowed) in rules.items():
        if key not in term:
            yield f".{key} is missing; it must be {allowed}"
        elif not fits(term[key]):
            yield f".{key}: {shown(term[key])}; it must be {allowed}"
    yield from (
        f".{shown(key)}: unknown; there are {', '.join(_MUST | _MAY)}" for key in term if key not in _MUST | _MAY
    )
    if term.get("per_degc") is True and term.get("degc_power", 1) != 1:
        yield f".degc_power: {shown(term['degc_power'])} contradicts per_degc, a power of 1; state degc_power alone"
