"""What a target is: how a calibration is written for it, how it is read back, and what of it is lost on the way."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_extended import corrected
from tumblecal.data.calibration_terms import checked
from tumblecal.data.sensor_parameters import SensorParameters, leaf_of
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[A-Za-z]\w*")
# Attitudes at which losses are counted: a lattice on the sphere (Fibonacci), and the axes both ways.
_ATTITUDES = 400
# Where a calibration says no temperature, its thermal terms are tried around this one.
_ROOM_DEGC = 25.0
# Below this (mg) a loss is rounding of the numbers, not worth a word.
_NOTHING_MG = 1e-4


# Parts of a linear calibration that not every format carries, and the leaves that they are.
_LEAVES = {"cross terms": "gamma", "bias": "bias"}


@dataclass(frozen=True)
class Export:
    """What a target writes.

    - `calibration`: no more than the target carries. `gravity_ms2`: one g in m/s^2.
    - `header`: lines for those formats that have comments.
    - `temperatures_degc`: the range in which thermal terms hold, where it is given.
    - `noise`: coefficients of each axis as `reduce` writes them, where given.
    """

    calibration: Calibration
    gravity_ms2: float
    header: tuple[str, ...] = ()
    temperatures_degc: tuple[float, float] | None = None
    noise: tuple[dict[str, float], ...] = ()

    @property
    def bias_ms2(self) -> Float[np.ndarray, "3"]:
        """The bias in m/s^2."""
        return self.calibration.bias * self.gravity_ms2

    def commented(self, mark: str) -> str:
        """The header with a mark of comments before each line."""
        return "".join(f"{mark} {line}\n" for line in self.header)


@dataclass(frozen=True)
class Target:
    """A device or program that takes a calibration.

    - `write`: the file's text. `read`: matrix, bias (g) and terms of such a text, given one g in m/s^2.
    - `carries`: of `cross terms`, `bias`, `bias temperature`, `terms` (all nonlinear and thermal ones).
    - `on_device`: what the device makes of the numbers that it is given.
    - `notes`: what a user must know; `source`: where the convention is from.
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
        """What of a linear calibration its format has no place for."""
        return [what for what in _LEAVES if what not in self.carries]

    def stated(self, calibration: Calibration) -> SensorParameters:
        """Those of a calibration's parameters that a file of this format states; the others it leaves open, not zero."""
        own = calibration.sensor
        left_open = {_LEAVES[what] for what in self.lacks}
        return own.of([name for name in own.names if leaf_of(name) not in left_open])

    def carried(self, calibration: Calibration, *, ranged: bool) -> Calibration:
        """The part of a calibration that the target's format has a place for; `ranged`: a range of temperature is given."""
        for _, part in _reductions(self, calibration, ranged=ranged):
            calibration = part
        return calibration


@dataclass(frozen=True)
class Numbers:
    """What stands in a target's file: `f = matrix (A - bias)`, bias in g, and terms as in a calibration file."""

    matrix: Float[np.ndarray, "3 3"]
    bias: Float[np.ndarray, "3"]
    terms: list[dict[str, Any]] = field(default_factory=list)

    def calibration(self, like: Calibration | None = None) -> Calibration:
        """As a calibration, its uncertainty unknown (a covariance of zeros)."""
        extra = {"terms": self.terms} if self.terms else {}
        if like is None:
            return Calibration(self.matrix, self.bias, np.zeros((12, 12)), extra=extra)
        return replace(like, matrix=self.matrix, bias=self.bias, extra=extra)


@dataclass(frozen=True)
class Loss:
    """What a format cannot carry, and what that makes at most at 1 g for this unit, mg (`per_degc`: for each degC)."""

    what: str
    mg: float
    per_degc: bool = False

    def __str__(self) -> str:
        return f"{self.what}: up to {self.mg:.3g} mg{' per degC' if self.per_degc else ''}"


def losses(target: Target, export: Export, whole: Calibration, text: str) -> list[Loss]:
    """What is lost of a calibration in a target's file, the largest error at 1 g in any attitude, cause by cause.

    **Arguments:**

    - `export`: what was written, `text`: the file. `whole`: the calibration that was to be exported.
    """
    lost, before = list[Loss](), whole
    for what, after in _on_the_way(target, export, whole, text):
        if what == TEMPERATURE:
            lost.append(Loss(what, farthest_mg(_thermal(before), _thermal(after), 1.0), per_degc=True))
        else:
            lost.append(Loss(what, farthest_mg(before, after)))
        before = after
    lost = [loss for loss in lost if loss.mg > _NOTHING_MG]
    if sum(not loss.per_degc for loss in lost) > 1:
        lost.append(Loss("altogether, at the temperature that it counts from", farthest_mg(whole, before)))
    return lost


TEMPERATURE = "temperature"


def _on_the_way(target: Target, export: Export, whole: Calibration, text: str) -> Iterator[tuple[str, Calibration]]:
    """A calibration on its way to the device: what each step is, and what is left after it."""
    carried, device = whole, target.on_device
    for what, carried in _reductions(target, whole, ranged=export.temperatures_degc is not None):
        yield what, carried
    if device is not None:
        used, words = device(carried, export.gravity_ms2)
        yield words, used
    read = target.read(text, export.gravity_ms2).calibration(carried)
    yield "rounding of the numbers in the file", read if device is None else device(read, export.gravity_ms2)[0]


def _reductions(target: Target, whole: Calibration, *, ranged: bool) -> Iterator[tuple[str, Calibration]]:
    """What the target has no place for, taken away in turn: its name, and what is left."""
    terms = checked(whole.extra.get("terms", []))
    if terms and "terms" not in target.carries:
        thermal = [term for term in terms if term.get("per_degc")]
        slopes = [t for t in thermal if of_bias(t)] if ranged and "bias temperature" in target.carries else []
        nonlinear = [term for term in terms if not term.get("per_degc")]
        for what, kept in ((TEMPERATURE, nonlinear + slopes), ("nonlinear terms", slopes)):
            if len(kept) < len(terms):
                whole = replace(whole, extra={**whole.extra, "terms": kept})
                terms = kept
                yield what, whole
    if "cross terms" not in target.carries:
        whole = replace(whole, matrix=np.diag(np.diag(whole.matrix)))
        yield "cross terms (off the matrix' diagonal)", whole
    if "bias" not in target.carries:
        whole = replace(whole, bias=np.zeros(3))
        yield "the bias", whole


def _thermal(calibration: Calibration) -> Calibration:
    """A calibration without the terms that temperature does not change: a sign that turns would count as a change."""
    terms = [term for term in checked(calibration.extra.get("terms", [])) if term.get("per_degc")]
    return replace(calibration, extra={"terms": terms})


def of_bias(term: dict[str, Any]) -> bool:
    """Whether a term does not depend on the input."""
    return not any(term["powers"]) and term.get("kind", "product") != "sign"


def bias_slopes(calibration: Calibration) -> tuple[Float[np.ndarray, "3"], float]:
    """Change of the bias with temperature, g/degC, and the temperature (degC) at which the bias holds.

    **Raises:** `InputError` where its terms count from several temperatures.
    """
    slopes, references = np.zeros(3), set[float]()
    for term in checked(calibration.extra.get("terms", [])):
        if term.get("per_degc") and of_bias(term):
            slopes[AXES.index(term["axis"])] += term["coefficient"]
            references.add(float(term["reference_degc"]))
    if len(references) > 1:
        raise InputError(
            "the thermal terms count from several temperatures; such a calibration cannot be exported here"
        )
    return slopes, references.pop() if references else calibration.temperature_degc or _ROOM_DEGC


def farthest_mg(first: Calibration, second: Calibration, degc: float = 0.0) -> float:
    """The largest difference of two calibrations' forces at 1 g, mg, `degc` above the temperature they count from."""
    readings = attitudes() @ np.linalg.inv(first.matrix).T + first.bias
    return float(np.max(np.abs(_force(first, readings, degc) - _force(second, readings, degc)))) * 1e3


def _force(calibration: Calibration, readings: np.ndarray, degc: float) -> np.ndarray:
    terms = checked(calibration.extra.get("terms", []))
    reference = next((t["reference_degc"] for t in terms if t.get("per_degc")), _ROOM_DEGC)
    return corrected(calibration, readings, np.full(len(readings), reference + degc))


def attitudes() -> Float[np.ndarray, "attitudes 3"]:
    """Directions of gravity: a Fibonacci lattice on the unit sphere, and the axes both ways."""
    k = np.arange(_ATTITUDES) + 0.5
    z, turn = 1 - 2 * k / _ATTITUDES, np.pi * (1 + np.sqrt(5)) * k
    lattice = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    return np.concatenate([lattice, np.eye(3), -np.eye(3)])


def numbers_after(text: str, key: str, count: int) -> Float[np.ndarray, " count"]:
    """The numbers that follow a key, between whatever brackets and commas.

    **Raises:** `InputError` where the key is missing, too few numbers follow, or a word stands where one should.
    """
    place = re.search(rf"(?<![\w]){re.escape(key)}(?!\w)", text)
    if place is None:
        raise InputError(f"{key} is missing")
    found = list(islice(_NUMBER.finditer(text, place.end()), count))
    if len(found) < count:
        raise InputError(f"{key}: {len(found)} numbers, {count} wanted")
    if word := _WORD.search(_NUMBER.sub(" ", text[place.end() : found[-1].end()])):
        raise InputError(f"{key}: {word[0]!r} stands where a number is wanted")
    if word := re.match(r"\w+", text[found[-1].end() :]):
        raise InputError(f"{key}: {found[-1][0] + word[0]!r} is not a number")
    return np.array([float(match[0]) for match in found])


def inverse(matrix: Float[np.ndarray, "3 3"], name: str) -> Float[np.ndarray, "3 3"]:
    """The inverse of a matrix that a file calls so.

    **Raises:** `InputError` where it has none.
    """
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError as error:
        raise InputError(f"{name} cannot be inverted") from error


def listed(values: np.ndarray, *, float32: bool = False) -> str:
    """Numbers with commas, every digit that the type has."""
    return ", ".join(number(value, float32=float32) for value in np.ravel(values))


def number(value: float, *, float32: bool = False) -> str:
    """A number as text that reads back to the same bits."""
    return f"{np.float32(value):.9g}" if float32 else repr(float(value))
