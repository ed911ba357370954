"""`use` of a calibration file: whether the calibration may be used, for which values, and why."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Field

from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.record import LEFT_OUT
from tumblecal.ground.strict_json import Finite, Text, one_of
from tumblecal.ground.units import in_words
from tumblecal.ground.units import shown as unit_shown


# From the widest use to none.
Answer = Literal["yes", "within", "only", "not tested", "no"]
_STRICTNESS: tuple[Answer, ...] = ("yes", "within", "only", "not tested", "no")
_NOT_STATED = "the calibration file does not state it (written by an earlier version)"


@dataclass(frozen=True)
class Use:
    """Whether a calibration may be used.

    - `answer`: `yes`: the error of a corrected reading at any attitude is within `expanded_g` in 95 % of cases. `within`: the
      same, only between two temperatures. `only`: for some parameters. `not tested`: nothing could test the model. `no`: the
      data contradict the model, or the values are unusable. None: the file does not state it.
    - `reason`: in words, one line; "" if there is nothing to add.
    - `temperature_degc`: lowest and highest temperature (degC) of its validity; None: no limit.
    - `parameters`: with `only`, the sensor parameters (names of `SENSOR`) that are determined.
    - `expanded_g`: expanded uncertainty U (k = 2) of each component of a corrected reading, g, at any attitude within the
      stated range. It includes effects that the data may have missed. None: not known.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="ignore")

    answer: Answer | None = None
    reason: Annotated[Text, AfterValidator(one_line)] = ""
    temperature_degc: Annotated[tuple[Finite, Finite] | None, LEFT_OUT] = None
    parameters: Annotated[tuple[Annotated[Text, one_of(SENSOR)], ...], LEFT_OUT] = ()
    expanded_g: Annotated[Annotated[Finite, Field(gt=0)] | None, LEFT_OUT] = None

    @property
    def refused(self) -> bool:
        """Whether the calibration must not be used."""
        return self.answer == "no"

    @property
    def untested(self) -> bool:
        """Whether nothing could test the model."""
        return self.answer == "not tested"

    @property
    def expanded_words(self) -> str:
        """U in words; "" if it is not known, or not valid because the model is wrong or was not tested."""
        if self.expanded_g is None or self.refused or self.untested:
            return ""
        unit, scale = unit_shown("g")
        return f"U = {in_words(f'{self.expanded_g * scale:.2g}', unit)} (k = 2) of a corrected reading at any attitude"

    @property
    def words(self) -> str:
        """The answer and its reason in one line."""
        if self.answer is None:
            return f"not stated: {_NOT_STATED}"
        positive = f"only for {', '.join(self.parameters)}" if self.parameters else "yes"
        parts = [self.answer if self.refused or self.untested else positive]
        if self.temperature_degc is not None and not self.refused:
            low, high = (f"{end:.4g}" for end in self.temperature_degc)
            parts.append(f"at about {low} degC" if low == high else f"from {low} to {high} degC only")
        if self.expanded_words:
            parts.append(self.expanded_words)
        return ", ".join(parts) + (f": {self.reason}" if self.reason else "")

    def require(self, path: Path | str, *, anyway: bool, tested: bool = False) -> None:
        """Reject a calibration that must not be used.

        **Arguments:**

        - `path`: of the calibration file. `anyway`: whether the user insists.
        - `tested`: whether to reject one whose model nothing could test, too.

        **Raises:** `InputError`.
        """
        if (self.refused or (tested and self.untested)) and not anyway:
            raise InputError(
                f"{path}: use: {self.words}. Repeat the measurement or the calibration; --use-anyway overrides this"
            )


def combined(uses: Iterable[Use], expanded_g: float | None = None) -> Use:
    """The use that several findings on one calibration allow: the strictest answer with its reasons, and the parameters and
    temperatures that every finding allows. `expanded_g`: as of `Use`."""
    stated = list(uses)
    allowed = [use.parameters for use in stated if use.parameters]
    names = tuple(name for name in SENSOR if allowed and all(name in listed for listed in allowed))
    ranges = [use.temperature_degc for use in stated if use.temperature_degc is not None]
    degc = (max(low for low, _ in ranges), min(high for _, high in ranges)) if ranges else None
    empty = (bool(allowed) and not names) or (degc is not None and degc[0] > degc[1])
    strictest = max((_STRICTNESS.index(use.answer or "yes") for use in stated), default=0)
    answer: Answer = "no" if empty else _STRICTNESS[strictest]
    deciding = [use for use in stated if use.refused] if answer == "no" and not empty else stated
    return Use(
        answer=answer,
        reason="; ".join(dict.fromkeys(use.reason for use in deciding if use.reason)),
        temperature_degc=None if empty else degc,
        parameters=names if answer == "only" else (),
        expanded_g=expanded_g,
    )


_PREFIXES = {"no": "Do not use it", "not tested": "Not tested", "only": "Usable only in part"}


@dataclass(frozen=True)
class Judgement:
    """One finding on a calibration.

    - `use`: the use that it allows. `advice`: instructions; "" if there are none. `finding`: in words, if it is not the reason
      of the use.
    - `uncertified`: whether no certificate is made, although the use is not `no`.
    """

    use: Use
    advice: str = ""
    finding: str = ""
    uncertified: bool = False

    @property
    def refused(self) -> bool:
        """Whether no certificate is made of the calibration."""
        return self.use.refused or self.use.untested or self.uncertified

    @property
    def tone(self) -> str:
        """Good, open or bad."""
        return "bad" if self.use.refused or self.uncertified else "open" if self.advice else "good"

    @property
    def words_of_finding(self) -> str:
        """The finding without the use."""
        return self.finding or self.use.reason

    @property
    def headline(self) -> str:
        """Use and finding."""
        return f"{_PREFIXES.get(self.use.answer or 'yes', 'Usable')}: {self.words_of_finding}."

    @property
    def words(self) -> str:
        """Headline and advice."""
        return f"{self.headline} {self.advice}".rstrip()


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
    if (answer == "within" and degc is None) or (answer == "yes" and degc is not None):
        raise ValueError(f"temperature_degc must be stated with 'within', and not with {answer!r}")
    if (answer == "only") != bool(use.parameters):
        raise ValueError(f"parameters must be listed with 'only', and only then; the answer is {answer!r}")
    return use


StatedUse = Annotated[Use, AfterValidator(_consistent)]
