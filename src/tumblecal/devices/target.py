"""Targets of an export: writing a calibration, reading it, and losses of the format."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.data.sensor_parameters import SensorParameters, leaf_of
from tumblecal.devices.temperature import at_temperature, export_degc, of_third_order, temperatures
from tumblecal.ground.errors import InputError


_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[A-Za-z]\w*")
# Number of attitudes for losses: a lattice on the sphere (Fibonacci), in addition to both directions of the axes.
_ATTITUDES = 400
# A smaller loss (mg) is due to rounding, and is not reported.
_NOTHING_MG = 1e-4
_HOUR_S = 3600.0


# Parts of a linear calibration that some formats do not include, and their leaves.
_LEAVES = {"cross terms": "gamma", "bias": "bias"}


@dataclass(frozen=True)
class Export:
    """Content of an exported file.

    - `calibration`: the part that the target includes. `gravity_ms2`: one g in m/s^2.
    - `header`: lines for formats with comments.
    - `temperatures_degc`: temperature range of thermal terms, if given. `run_s`: operating time of the device, s, if given.
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

    - `write`: text of the file. `read`: matrix, bias (g) and terms of such a text, for one g in m/s^2.
    - `carries`: included parts, of `cross terms`, `bias`, `bias temperature` (third order, within a range), `terms` (all).
    - `on_device`: the calibration that the device applies, with words on the difference.
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
    on_device: Callable[[Calibration, float], tuple[Calibration, str]] | None = None

    @property
    def lacks(self) -> list[str]:
        """Parts of a linear calibration that the format does not include."""
        return [part for part in _LEAVES if part not in self.carries]

    def stated(self, calibration: Calibration) -> SensorParameters:
        """The parameters of a calibration that a file of this format states; the others are unknown, not zero."""
        sensor = calibration.sensor
        unknown = {_LEAVES[part] for part in self.lacks}
        return sensor.of([name for name in sensor.names if leaf_of(name) not in unknown])

    def carried(self, calibration: Calibration, temperatures_degc: tuple[float, float] | None = None) -> Calibration:
        """The part of a calibration that the format includes, for a temperature range (degC)."""
        for _, part in _reductions(self, calibration, temperatures_degc):
            calibration = part
        return calibration


@dataclass(frozen=True)
class Numbers:
    """Numbers in the file of a target: `f = matrix (A - bias)`, bias in g, and terms as in a calibration file."""

    matrix: Float[np.ndarray, "3 3"]
    bias: Float[np.ndarray, "3"]
    terms: Sequence[Term] = ()

    def calibration(self, like: Calibration | None = None) -> Calibration:
        """The numbers as a calibration with unknown uncertainty (a covariance of zeros)."""
        if like is None:
            like = Calibration(self.matrix, self.bias, np.zeros((12, 12)))
        return replace(like, matrix=self.matrix, bias=self.bias, extra={}).with_terms(self.terms)


@dataclass(frozen=True)
class Loss:
    """A loss of a format, and its largest error at 1 g for this unit, mg; `per`: for each degC or h.

    Examples:
        >>> from tumblecal.devices import Loss
        >>> str(Loss("bias over temperature", 0.0213, "degC"))
        'bias over temperature: up to 0.0213 mg per degC'
    """

    what: str
    mg: float
    per: Literal["", "degC", "h"] = ""

    def __str__(self) -> str:
        return f"{self.what}: up to {self.mg:.3g} mg{f' per {self.per}' if self.per else ''}"


def losses(target: Target, export: Export, whole: Calibration, text: str) -> list[Loss]:
    """The losses of a calibration in the file of a target, by cause: the largest error at 1 g in any attitude.

    They apply to the temperature range and operating time of the export; if not given, to the references of thermal and drift
    terms, and for these terms to one degC and one hour.

    **Arguments:**

    - `export`: the exported content, `text`: the file. `whole`: the complete calibration.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.data import Calibration
        >>> from tumblecal.devices import TARGETS, Export, losses
        >>> matrix = np.eye(3) + [[0.02, 0.0, 0.0], [3e-4, 0.02, 0.0], [0.0, 0.0, 0.02]]
        >>> whole = Calibration(matrix, np.array([0.01, 0.01, 0.01]), np.zeros((12, 12)))
        >>> target = TARGETS["ardupilot"]
        >>> export = Export(target.carried(whole), gravity_ms2=9.81)
        >>> for loss in losses(target, export, whole, target.write(export)):
        ...     print(loss)
        cross terms (off the matrix' diagonal): up to 0.294 mg
    """
    lost, before = list[Loss](), whole
    span, run_s = export.temperatures_degc, export.run_s
    grid, reference = temperatures(whole, span).tolist(), export_degc(whole, span)
    starts = {term.reference_s for term in whole.terms if term.per_hour}
    start_s, ends_s = min(starts, default=0.0), max(starts, default=0.0) + (_HOUR_S if run_s is None else run_s)
    for what, after in _on_the_way(target, export, whole, text):
        if what.startswith(DRIFT):
            over = "" if run_s is None else f", over {run_s / _HOUR_S:.3g} h"
            lost.append(Loss(what + over, farthest_mg(before, after, grid, ends_s), "h" if run_s is None else ""))
        elif what.startswith(TEMPERATURE):
            changed = thermal_part(before), thermal_part(after)
            over, at = ("", [reference + 1.0]) if span is None else (f", from {span[0]:g} to {span[1]:g} degC", grid)
            lost.append(Loss(what + over, farthest_mg(*changed, at), "degC" if span is None else ""))
        else:
            lost.append(Loss(what, farthest_mg(before, after, [reference], start_s)))
        before = after
    lost = [loss for loss in lost if loss.mg > _NOTHING_MG]
    if sum(not loss.per for loss in lost) > 1:
        where = "at its reference temperature" if span is None else f"from {span[0]:g} to {span[1]:g} degC"
        lost.append(Loss(f"in total, {where}", farthest_mg(whole, before, grid, start_s if run_s is None else ends_s)))
    return lost


DRIFT, TEMPERATURE, NONLINEAR = "drift", "temperature", "nonlinear terms"


def _on_the_way(target: Target, export: Export, whole: Calibration, text: str) -> Iterator[tuple[str, Calibration]]:
    """The steps from a calibration to the device: words for each step, and the calibration after it."""
    carried, device = whole, target.on_device
    for what, carried in _reductions(target, whole, export.temperatures_degc):
        yield what, carried
    if device is not None:
        used, words = device(carried, export.gravity_ms2)
        yield words, used
    read = target.read(text, export.gravity_ms2).calibration(carried)
    yield "rounding of the numbers in the file", read if device is None else device(read, export.gravity_ms2)[0]


def _reductions(
    target: Target, whole: Calibration, span: tuple[float, float] | None
) -> Iterator[tuple[str, Calibration]]:
    """The parts that the target does not include, removed in turn: name, and the calibration without the part."""
    # No target has parameters that follow temperature yet.
    if whole.temperature is not None:
        whole = whole.at(export_degc(whole, span), extrapolate=True)
        yield f"{TEMPERATURE} (curves of the parameters)", whole
    # No target has the time since the start of the run.
    for what, group in _by_effect(DRIFT, [term for term in whole.terms if term.per_hour]):
        whole = whole.with_terms([term for term in whole.terms if term not in group])
        yield what, whole
    if whole.terms and "terms" not in target.carries:
        polynomial = span is not None and "bias temperature" in target.carries
        thermal = [term for term in whole.terms if term.thermal and not (polynomial and term.of_bias)]
        for what, group in (*_by_effect(TEMPERATURE, thermal), *_by_effect(NONLINEAR, _not_thermal(whole))):
            whole = at_temperature(whole, export_degc(whole, span), group)
            yield what, whole
        if span is not None and any(term.thermal for term in whole.terms):
            whole = of_third_order(whole, span)
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


def thermal_part(calibration: Calibration) -> Calibration:
    """A calibration with its thermal terms only, because a change of sign in another term would look like a thermal change."""
    return calibration.with_terms([term for term in calibration.terms if term.thermal])


def farthest_mg(
    first: Calibration, second: Calibration, temperatures_degc: Sequence[float], time_s: float | None = None
) -> float:
    """The largest difference of the forces of two calibrations at 1 g over some temperatures, mg; drift terms at one time."""
    readings = attitudes() @ np.linalg.inv(first.matrix).T + first.bias

    def force(of: Calibration, degc: float) -> np.ndarray:
        return of.corrected(readings, degc, time_s, extrapolate=True)

    return 1e3 * max(float(np.max(np.abs(force(first, degc) - force(second, degc)))) for degc in temperatures_degc)


def attitudes() -> Float[np.ndarray, "attitudes 3"]:
    """Directions of gravity: a Fibonacci lattice on the unit sphere, and both directions of the axes."""
    k = np.arange(_ATTITUDES) + 0.5
    z, turn = 1 - 2 * k / _ATTITUDES, np.pi * (1 + np.sqrt(5)) * k
    lattice = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    return np.concatenate([lattice, np.eye(3), -np.eye(3)])


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
