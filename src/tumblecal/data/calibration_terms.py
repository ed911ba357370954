"""The terms of a calibration file, in addition to matrix and bias: of any order in the inputs and the temperature.

A term adds `coefficient * kind(u_x^i u_y^j u_z^k) * (T - reference_degc)^degc_power * hours` to the reading of one axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Annotated, Any, ClassVar

import numpy as np
from jaxtyping import Float
from pydantic import BeforeValidator, ConfigDict, Field

from tumblecal.ground.axes import AXES
from tumblecal.ground.strict_json import Finite, Flag, Text, one_of, validated


KINDS = {"product": lambda value: value, "abs": np.abs, "sign": np.sign}
Power = Annotated[int, Field(strict=True, ge=0, le=9)]


@dataclass(frozen=True)
class Term:
    """One term of a calibration.

    - `axis`: of the output. `coefficient`: g, degC, h. `powers`: of the inputs along x, y and z. `kind`: `product`, or `abs` or
      `sign` of that product.
    - `degc_power`: power of the temperature less `reference_degc`; 0: independent of the temperature.
    - `per_hour`: whether it is multiplied by the hours since `reference_s`.
    - `effect`: id of the catalogue entry, "" if not stated. `determined`: whether the data determined it separately.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    axis: Annotated[Text, one_of(AXES)]
    coefficient: Finite
    powers: tuple[Power, Power, Power] = (0, 0, 0)
    kind: Annotated[Text, one_of((*KINDS,))] = "product"
    degc_power: Power = 0
    reference_degc: Finite = 0.0
    per_hour: Flag = False
    reference_s: Finite = 0.0
    effect: Text = ""
    determined: Flag = True

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


def _in_full(stated: Any) -> Any:
    """A stated term with `degc_power` in place of `per_degc`, the form of all versions for a power of one.

    **Raises:** `ValueError` for a missing key that has a default only for terms that do not need it.
    """
    if not isinstance(stated, dict):
        return stated
    needed = {"per_degc": "reference_degc", "degc_power": "reference_degc", "per_hour": "reference_s"}
    for key in ("powers", *(needed[key] for key in needed if stated.get(key))):
        if key not in stated:
            raise ValueError(f"{key} is missing; add it")
    power = {"degc_power": int(per_degc)} if isinstance(per_degc := stated.get("per_degc"), bool) else {}
    if power and stated.get("degc_power", 1) != 1:
        raise ValueError("degc_power contradicts per_degc, a power of 1; state degc_power alone")
    return {key: value for key, value in stated.items() if key != "per_degc" or not power} | power


# Key of a calibration file for the covariance of matrix, bias and terms together.
WITH_TERMS = "covariance_with_terms"

Terms = list[Annotated[Term, BeforeValidator(_in_full)]]


def terms_of(stated: object, named: str = "calibration") -> tuple[Term, ...]:
    """The terms that a calibration file states.

    **Arguments:**

    - `named`: the file, for faults.

    **Raises:** `InputError`, one line for each fault.
    """
    return tuple(validated(stated, Terms, named, "terms"))


def contributions(
    terms: Sequence[Term], inputs: Float[np.ndarray, "rows 3"], temperature_degc: Float[np.ndarray, " degc"] | None
) -> Float[np.ndarray, "terms degc rows 3"]:
    """Change of the readings (g) by one unit of each term's coefficient, for all inputs (g) at each temperature; without a
    temperature, one degree from the reference. Time has no influence."""
    count = 1 if temperature_degc is None else len(temperature_degc)
    changes = np.zeros((len(terms), count, len(inputs), 3))
    for change, term in zip(changes, terms, strict=True):
        factor = replace(term, coefficient=1.0).factor(temperature_degc, None)
        change[:, :, AXES.index(term.axis)] = np.reshape(factor, (-1, 1)) * term.of_inputs(inputs)
    return changes


def undetermined_words(terms: Sequence[Term]) -> str:
    """Words on terms that the data determine only in combination; "" if they determine each separately."""
    ids = dict.fromkeys(term.effect or f"a term of axis {term.axis}" for term in terms if not term.determined)
    if not ids:
        return ""
    return f"not determined separately, so the correction is valid near 1 g: {', '.join(ids)}"
