"""Targets of an export: writing a calibration, reading it, and the part of a calibration that the format includes."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.sensor_parameters import SensorParameters, leaf_of
from tumblecal.devices.over_temperature import (
    at_temperature,
    export_degc,
    of_third_order,
    table_degc,
    with_curves_of_bias,
)
from tumblecal.ground.errors import InputError


_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[A-Za-z]\w*")
# Parts of a linear calibration that some formats do not include, and their leaves.
_LEAVES = {"cross terms": "gamma", "bias": "bias"}
# What formats include, by the keys of `Target.carries`.
LINEAR, DIAGONAL = frozenset({"cross terms", "bias"}), frozenset({"bias", "bias temperature"})
DRIFT, TEMPERATURE, NONLINEAR = "drift", "temperature", "nonlinear terms"


@dataclass(frozen=True)
class Export:
    """Content of an exported file.

    - `calibration`: the part that the target includes. `gravity_ms2`: one g in m/s^2.
    - `header`: lines for formats with comments.
    - `temperatures_degc`: temperature range of curves and thermal terms, if given. `at_degc`: the temperature of constant
      parameters, if given. `table_step_degc`: step of a table over temperature, if given.
    - `run_s`: operating time of the device, s, if given.
    - `noise`: coefficients of each axis as written by `reduce`, if given.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.data import Calibration
        >>> from tumblecal.devices import Export
        >>> calibration = Calibration(np.eye(3), np.array([1e-3, 0.0, 0.0]), np.zeros((12, 12)))
        >>> Export(calibration, gravity_ms2=9.81).bias_ms2.round(5).tolist()
        [0.00981, 0.0, 0.0]
    """

    calibration: Calibration
    gravity_ms2: float
    header: tuple[str, ...] = ()
    temperatures_degc: tuple[float, float] | None = None
    noise: tuple[dict[str, float], ...] = ()
    run_s: float | None = None
    at_degc: float | None = None
    table_step_degc: float | None = None

    @property
    def table_degc(self) -> Float[np.ndarray, " rows"]:
        """The temperatures (degC) of a table, over the given range or that of the curves; none without curves or a step."""
        curves = self.calibration.temperature
        if curves is None or self.table_step_degc is None:
            return np.zeros(0)
        return table_degc(self.temperatures_degc or curves.range_degc, self.table_step_degc)

    @property
    def bias_ms2(self) -> Float[np.ndarray, "3"]:
        """The bias in m/s^2."""
        return self.calibration.bias * self.gravity_ms2

    def commented(self, mark: str) -> str:
        """The header with a comment mark before each line."""
        return "".join(f"{mark} {line}\n" for line in self.header)


@dataclass(frozen=True)
class Target:
    """A device or program with a format for calibrations.

    - `write`: text of the file. `read`: the calibration in such a text, for one g in m/s^2, with unknown uncertainty (zero).
    - `carries`: included parts, of `cross terms`, `bias`, `bias temperature` (third order, within a range), `terms` (all),
      `curves` (of all parameters).
    - `on_device`: the calibration that the device applies, with words on the difference.
    - `held_degc`: the device changes its thermal correction after this change of temperature, with words on that.
    - `notes`: notes for the user; `source`: source of the convention.

    Examples:
        >>> from tumblecal.devices import TARGETS
        >>> TARGETS["px4"].lacks, TARGETS["json"].lacks
        (['cross terms'], [])
    """

    name: str
    words: str
    write: Callable[[Export], str]
    read: Callable[[str, float], Calibration]
    carries: frozenset[str]
    source: str
    notes: tuple[str, ...] = ()
    on_device: Callable[[Calibration, Export], tuple[Calibration, str]] | None = None
    held_degc: tuple[float, str] | None = None

    @property
    def lacks(self) -> list[str]:
        """Parts of a linear calibration that the format does not include."""
        return [part for part in _LEAVES if part not in self.carries]

    def stated(self, calibration: Calibration) -> SensorParameters:
        """The parameters of a calibration that a file of this format states; the others are unknown, not zero."""
        sensor, unknown = calibration.sensor, {_LEAVES[part] for part in self.lacks}
        return sensor.of([name for name in sensor.names if leaf_of(name) not in unknown])

    def carried(
        self,
        calibration: Calibration,
        temperatures_degc: tuple[float, float] | None = None,
        at_degc: float | None = None,
    ) -> Calibration:
        """The part of a calibration that the format includes, for a temperature range, and constants at one temperature."""
        return [calibration, *(part for _, part in reductions(self, calibration, temperatures_degc, at_degc))][-1]


def reductions(
    target: Target, whole: Calibration, span: tuple[float, float] | None, at_degc: float | None
) -> Iterator[tuple[str, Calibration]]:
    """The parts that the target does not include, removed in turn: name, and the calibration without the part."""
    degc, carries = export_degc(whole, span, at_degc), target.carries
    polynomial = span is not None and "bias temperature" in carries
    if whole.temperature is not None and polynomial:
        whole = with_curves_of_bias(whole, degc)
        yield f"{TEMPERATURE} (scale factors and cross terms: values at {degc:.4g} degC)", whole
    elif whole.temperature is not None and ("curves" not in carries or at_degc is not None):
        whole = whole.at(degc, extrapolate=True)
        yield f"{TEMPERATURE} (all parameters: values at {degc:.4g} degC)", whole
    # No target has the time since the start of the run. Terms are removed by effect, first drift, then those of temperature.
    lost = dict[str, list]()
    for term in whole.terms:
        kind = DRIFT if term.per_hour else TEMPERATURE if term.thermal else NONLINEAR
        if term.per_hour or ("terms" not in carries and not (polynomial and term.thermal and term.of_bias)):
            lost.setdefault(f"{kind} ({term.effect})" if term.effect else kind, []).append(term)
    for what, terms in sorted(
        lost.items(), key=lambda item: (DRIFT, TEMPERATURE, NONLINEAR).index(item[0].split(" (")[0])
    ):
        kept = [term for term in whole.terms if term not in terms]
        whole = whole.with_terms(kept) if terms[0].per_hour else at_temperature(whole, degc, terms)
        yield what, whole
    if span is not None and polynomial and "temperature_degc" in whole.columns_needed:
        whole = of_third_order(whole, span, degc)
        yield f"{TEMPERATURE}, above third order", whole
    if "cross terms" not in carries:
        whole = replace(whole, matrix=np.diag(np.diag(whole.matrix)))
        yield "cross terms (off the matrix' diagonal)", whole
    if "bias" not in carries:
        whole = replace(whole, bias=np.zeros(3))
        yield "the bias", whole


def numbers_after(text: str, key: str, count: int) -> Float[np.ndarray, " count"]:
    """The numbers after a key, between any brackets and commas.

    **Raises:** `InputError` if the key is missing, too few numbers follow, or a word is in place of a number.
    """
    place = re.search(rf"(?<![\w]){re.escape(key)}(?!\w)", text)
    if place is None:
        raise InputError(f"{key} is missing")
    found = list(islice(_NUMBER.finditer(text, place.end()), count))
    if len(found) < count:
        raise InputError(f"{key}: {len(found)} numbers; there must be {count}")
    if word := _WORD.search(_NUMBER.sub(" ", text[place.end() : found[-1].end()])):
        raise InputError(f"{key}: {word[0]!r} in place of a number")
    if word := re.match(r"\w+", text[found[-1].end() :]):
        raise InputError(f"{key}: {found[-1][0] + word[0]!r} is not a number")
    return np.array([float(match[0]) for match in found])


def number(value: float, *, float32: bool = False) -> str:
    """A number as text with full precision."""
    return f"{np.float32(value):.9g}" if float32 else repr(float(value))


def listed(values: np.ndarray) -> str:
    """Numbers separated by commas, with full precision."""
    return ", ".join(map(number, np.ravel(values).tolist()))
