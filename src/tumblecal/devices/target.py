"""Targets of an export: writing a calibration, reading it, and the part of a calibration that the format includes."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.data.sensor_parameters import SensorParameters, leaf_of
from tumblecal.data.temperature_curves import TemperatureCurves
from tumblecal.devices.temperature import (
    at_temperature,
    export_degc,
    of_third_order,
    with_curves_of_bias,
)
from tumblecal.devices.temperature_table import table_degc
from tumblecal.ground.errors import InputError


_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[A-Za-z]\w*")


# Parts of a linear calibration that some formats do not include, and their leaves.
_LEAVES = {"cross terms": "gamma", "bias": "bias"}


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

    - `write`: text of the file. `read`: matrix, bias (g), terms and curves of such a text, for one g in m/s^2.
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
    suffix: str
    words: str
    write: Callable[[Export], str]
    read: Callable[[str, float], "Numbers"]
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
        sensor = calibration.sensor
        unknown = {_LEAVES[part] for part in self.lacks}
        return sensor.of([name for name in sensor.names if leaf_of(name) not in unknown])

    def carried(
        self,
        calibration: Calibration,
        temperatures_degc: tuple[float, float] | None = None,
        at_degc: float | None = None,
    ) -> Calibration:
        """The part of a calibration that the format includes, for a temperature range, and constants at one temperature."""
        for _, part in reductions(self, calibration, temperatures_degc, at_degc):
            calibration = part
        return calibration


@dataclass(frozen=True)
class Numbers:
    """Numbers in the file of a target: `f = matrix (A - bias)`, bias in g, and terms and curves as in a calibration file.

    `temperature_degc`: the temperature of matrix and bias; None if the format does not state it.
    """

    matrix: Float[np.ndarray, "3 3"]
    bias: Float[np.ndarray, "3"]
    terms: Sequence[Term] = ()
    temperature: TemperatureCurves | None = None
    temperature_degc: float | None = None

    def calibration(self, like: Calibration | None = None) -> Calibration:
        """The numbers as a calibration with unknown uncertainty (a covariance of zeros)."""
        if like is None:
            like = Calibration(self.matrix, self.bias, np.zeros((12, 12)), temperature_degc=self.temperature_degc)
        known = like.parameters if self.temperature is None else None
        numbers = replace(
            like, matrix=self.matrix, bias=self.bias, extra={}, temperature=self.temperature, parameters=known
        )
        return numbers.with_terms(self.terms)


DRIFT, TEMPERATURE, NONLINEAR = "drift", "temperature", "nonlinear terms"


def reductions(
    target: Target, whole: Calibration, span: tuple[float, float] | None, at_degc: float | None
) -> Iterator[tuple[str, Calibration]]:
    """The parts that the target does not include, removed in turn: name, and the calibration without the part."""
    degc = export_degc(whole, span, at_degc)
    polynomial = span is not None and "bias temperature" in target.carries
    if whole.temperature is not None and polynomial:
        whole = with_curves_of_bias(whole, degc)
        yield f"{TEMPERATURE} (scale factors and cross terms: values at {degc:.4g} degC)", whole
    elif whole.temperature is not None and ("curves" not in target.carries or at_degc is not None):
        whole = whole.at(degc, extrapolate=True)
        yield f"{TEMPERATURE} (all parameters: values at {degc:.4g} degC)", whole
    # No target has the time since the start of the run.
    for what, group in _by_effect(DRIFT, [term for term in whole.terms if term.per_hour]):
        whole = whole.with_terms([term for term in whole.terms if term not in group])
        yield what, whole
    if whole.terms and "terms" not in target.carries:
        thermal = [term for term in whole.terms if term.thermal and not (polynomial and term.of_bias)]
        for what, group in (*_by_effect(TEMPERATURE, thermal), *_by_effect(NONLINEAR, _not_thermal(whole))):
            whole = at_temperature(whole, degc, group)
            yield what, whole
    if span is not None and polynomial and "temperature_degc" in whole.columns_needed:
        whole = of_third_order(whole, span, degc)
        yield f"{TEMPERATURE}, above third order", whole
    if "cross terms" not in target.carries:
        whole = replace(whole, matrix=np.diag(np.diag(whole.matrix)))
        yield "cross terms (off the matrix' diagonal)", whole
    if "bias" not in target.carries:
        whole = replace(whole, bias=np.zeros(3))
        yield "the bias", whole


def _not_thermal(calibration: Calibration) -> list[Term]:
    return [term for term in calibration.terms if not term.thermal]


def _by_effect(what: str, terms: Sequence[Term]) -> list[tuple[str, list[Term]]]:
    """Terms grouped by effect, with words for each group."""
    effects = dict.fromkeys(term.effect for term in terms)
    groups = [(effect, [term for term in terms if term.effect == effect]) for effect in effects]
    return [(f"{what} ({effect})" if effect else what, group) for effect, group in groups]


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


def inverse(matrix: Float[np.ndarray, "3 3"], name: str) -> Float[np.ndarray, "3 3"]:
    """The inverse of a matrix with this name in a file.

    **Raises:** `InputError` for a singular matrix.
    """
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError as error:
        raise InputError(f"{name} cannot be inverted") from error


def listed(values: np.ndarray, *, float32: bool = False) -> str:
    """Numbers separated by commas, with full precision of the type."""
    return ", ".join(number(value, float32=float32) for value in np.ravel(values))


def number(value: float, *, float32: bool = False) -> str:
    """A number as text with full precision."""
    return f"{np.float32(value):.9g}" if float32 else repr(float(value))
