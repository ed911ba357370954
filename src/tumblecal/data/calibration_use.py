"""`use` of a calibration file: whether the calibration may be used, for which values, and why."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Field

from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.strict_json import Finite, Text, one_of
from tumblecal.ground.units import in_words
from tumblecal.ground.units import shown as unit_shown


Answer = Literal["yes", "within", "only", "no"]
_NOT_STATED = "the calibration file does not state it (written by an earlier version)"


@dataclass(frozen=True)
class Use:
    """Whether a calibration may be used.

    - `answer`: `yes`; `within` (only between two temperatures, or to a size, or both); `only` (for some parameters); `no`;
      None: the file does not state it.
    - `reason`: in words, one line; "" if there is nothing to add.
    - `temperature_degc`: lowest and highest temperature (degC) of its validity; None: no limit.
    - `parameters`: with `only`, the sensor parameters (names of `SENSOR`) that are determined.
    - `size_g`: remaining systematic error (g), if its size is known: the calibration is valid to about this size.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="ignore")

    answer: Answer | None = None
    reason: Annotated[Text, AfterValidator(one_line)] = ""
    temperature_degc: tuple[Finite, Finite] | None = None
    parameters: tuple[Annotated[Text, one_of(SENSOR)], ...] = ()
    size_g: Annotated[Finite, Field(gt=0)] | None = None

    @property
    def refused(self) -> bool:
        """Whether the calibration must not be used."""
        return self.answer == "no"

    @property
    def words(self) -> str:
        """The answer and its reason in one line."""
        if self.answer is None:
            return f"not stated: {_NOT_STATED}"
        parts = [f"only for {', '.join(self.parameters)}" if self.parameters else "no" if self.refused else "yes"]
        if self.temperature_degc is not None and not self.refused:
            low, high = (f"{end:.4g}" for end in self.temperature_degc)
            parts.append(f"at about {low} degC" if low == high else f"from {low} to {high} degC only")
        if self.size_g is not None:
            unit, scale = unit_shown("g")
            size = in_words(f"{self.size_g * scale:.2g}", unit)
            parts.append(f"{'except ' if self.refused else ''}to about {size}")
        return ", ".join(parts) + (f": {self.reason}" if self.reason else "")

    def require(self, path: Path | str, *, anyway: bool) -> None:
        """Reject a calibration that must not be used.

        **Arguments:**

        - `path`: of the calibration file. `anyway`: whether the user insists.

        **Raises:** `InputError`.
        """
        if self.refused and not anyway:
            raise InputError(
                f"{path}: use: {self.words}. Repeat the measurement or the calibration; --use-anyway overrides this"
            )

    def record(self) -> dict[str, Any]:
        """The record in a JSON file; empty if nothing is stated."""
        if self.answer is None:
            return {}
        limits: dict[str, Any] = {
            "temperature_degc": None if self.temperature_degc is None else list(self.temperature_degc),
            "parameters": list(self.parameters) or None,
            "size_g": self.size_g,
        }
        return {
            "answer": self.answer,
            "reason": self.reason,
            **{key: limit for key, limit in limits.items() if limit is not None},
        }


def combined(uses: Iterable[Use]) -> Use:
    """The use that several findings on one calibration allow: the strictest answer with its reasons, the parameters and
    temperatures that every finding allows, and the largest systematic error."""
    stated = list(uses)
    allowed = [use.parameters for use in stated if use.parameters]
    names = tuple(name for name in SENSOR if allowed and all(name in listed for listed in allowed))
    ranges = [use.temperature_degc for use in stated if use.temperature_degc is not None]
    degc = (max(low for low, _ in ranges), min(high for _, high in ranges)) if ranges else None
    sizes = [use.size_g for use in stated if use.size_g is not None]
    empty = (bool(allowed) and not names) or (degc is not None and degc[0] > degc[1])
    refused = empty or any(use.refused for use in stated)
    limited = degc is not None or any(use.answer == "within" for use in stated)
    answer: Answer = "no" if refused else "only" if names else "within" if limited else "yes"
    deciding = [use for use in stated if use.refused] if refused and not empty else stated
    return Use(
        answer=answer,
        reason="; ".join(dict.fromkeys(use.reason for use in deciding if use.reason)),
        temperature_degc=None if empty else degc,
        parameters=() if refused else names,
        size_g=max(sizes, default=None),
    )


# No limit; and a file of an earlier version, which does not state its use.
YES = Use("yes")
NOT_STATED = Use()


def _consistent(use: Use) -> Use:
    """Reject an answer without its limits, or with those of a different answer."""
    degc, answer = use.temperature_degc, use.answer
    if answer is None:
        raise ValueError("answer is missing; add it")
    if degc is not None and degc[0] > degc[1]:
        raise ValueError(f"temperature_degc: the lowest temperature must come first (got {[*degc]})")
    if (answer == "within" and degc is None and use.size_g is None) or (answer == "yes" and degc is not None):
        raise ValueError(f"temperature_degc must be stated with 'within' (or size_g), and not with {answer!r}")
    if (answer == "only") != bool(use.parameters):
        raise ValueError(f"parameters must be listed with 'only', and only then; the answer is {answer!r}")
    return use


StatedUse = Annotated[Use, AfterValidator(_consistent)]
