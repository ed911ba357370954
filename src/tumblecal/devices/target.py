"""What a target is: how a calibration is written for it, how it is read back, and what of it is lost on the way."""

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
from tumblecal.devices.temperature import at_temperature, held_degc, of_third_order, temperatures
from tumblecal.ground.errors import InputError


_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[A-Za-z]\w*")
# Attitudes at which losses are counted: a lattice on the sphere (Fibonacci), and the axes both ways.
_ATTITUDES = 400
# Below this (mg) a loss is rounding of the numbers, not worth a word.
_NOTHING_MG = 1e-4
_HOUR_S = 3600.0


# Parts of a linear calibration that not every format carries, and the leaves that they are.
_LEAVES = {"cross terms": "gamma", "bias": "bias"}


@dataclass(frozen=True)
class Export:
    """What a target writes.

    - `calibration`: no more than the target carries. `gravity_ms2`: one g in m/s^2.
    - `header`: lines for those formats that have comments.
    - `temperatures_degc`: the range in which thermal terms hold, where it is given. `run_s`: how long the device runs, s.
    - `noise`: coefficients of each axis as `reduce` writes them, where given.
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
        """The header with a mark of comments before each line."""
        return "".join(f"{mark} {line}\n" for line in self.header)


@dataclass(frozen=True)
class Target:
    """A device or program that takes a calibration.

    - `write`: the file's text. `read`: matrix, bias (g) and terms of such a text, given one g in m/s^2.
    - `carries`: of `cross terms`, `bias`, `bias temperature` (of third order, within a range), `terms` (all of them).
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

    def carried(self, calibration: Calibration, temperatures_degc: tuple[float, float] | None = None) -> Calibration:
        """The part of a calibration that the target's format has a place for, given a range of temperature (degC)."""
        for _, part in _reductions(self, calibration, temperatures_degc):
            calibration = part
        return calibration


@dataclass(frozen=True)
class Numbers:
    """What stands in a target's file: `f = matrix (A - bias)`, bias in g, and terms as in a calibration file."""

    matrix: Float[np.ndarray, "3 3"]
    bias: Float[np.ndarray, "3"]
    terms: Sequence[Term] = ()

    def calibration(self, like: Calibration | None = None) -> Calibration:
        """As a calibration, its uncertainty unknown (a covariance of zeros)."""
        if like is None:
            like = Calibration(self.matrix, self.bias, np.zeros((12, 12)))
        return replace(like, matrix=self.matrix, bias=self.bias, extra={}).with_terms(self.terms)


@dataclass(frozen=True)
class Loss:
    """What a format cannot carry, and the largest error that this makes at 1 g for this unit, mg; `per`: for each degC or h."""

    what: str
    mg: float
    per: Literal["", "degC", "h"] = ""

    def __str__(self) -> str:
        return f"{self.what}: up to {self.mg:.3g} mg{f' per {self.per}' if self.per else ''}"


def losses(target: Target, export: Export, whole: Calibration, text: str) -> list[Loss]:
    """What is lost of a calibration in a target's file, cause by cause: the largest error at 1 g in any attitude.

    It is over the range of temperature and the run time if the export has them; otherwise where thermal and drift terms count
    from, theirs for each degC and h.

    **Arguments:**

    - `export`: what was written, `text`: the file. `whole`: the calibration that was to be exported.
    """
    lost, before = list[Loss](), whole
    span, run_s = export.temperatures_degc, export.run_s
    grid, held = temperatures(whole, span).tolist(), held_degc(whole, span)
    starts = {term.reference_s for term in whole.terms if term.per_hour}
    start_s, ends_s = min(starts, default=0.0), max(starts, default=0.0) + (_HOUR_S if run_s is None else run_s)
    for what, after in _on_the_way(target, export, whole, text):
        if what.startswith(DRIFT):
            over = "" if run_s is None else f", over {run_s / _HOUR_S:.3g} h"
            lost.append(Loss(what + over, farthest_mg(before, after, grid, ends_s), "h" if run_s is None else ""))
        elif what.startswith(TEMPERATURE):
            changed = thermal_part(before), thermal_part(after)
            over, at = ("", [held + 1.0]) if span is None else (f", from {span[0]:g} to {span[1]:g} degC", grid)
            lost.append(Loss(what + over, farthest_mg(*changed, at), "degC" if span is None else ""))
        else:
            lost.append(Loss(what, farthest_mg(before, after, [held], start_s)))
        before = after
    lost = [loss for loss in lost if loss.mg > _NOTHING_MG]
    if sum(not loss.per for loss in lost) > 1:
        where = "at the temperature that it counts from" if span is None else f"from {span[0]:g} to {span[1]:g} degC"
        lost.append(
            Loss(f"altogether, {where}", farthest_mg(whole, before, grid, start_s if run_s is None else ends_s))
        )
    return lost


DRIFT, TEMPERATURE, NONLINEAR = "drift", "temperature", "nonlinear terms"


def _on_the_way(target: Target, export: Export, whole: Calibration, text: str) -> Iterator[tuple[str, Calibration]]:
    """A calibration on its way to the device: what each step is, and what is left after it."""
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
    """What the target has no place for, taken away in turn: its name, and the calibration without it."""
    # No target knows the time since the start of the run.
    for what, group in _by_effect(DRIFT, [term for term in whole.terms if term.per_hour]):
        whole = whole.with_terms([term for term in whole.terms if term not in group])
        yield what, whole
    if whole.terms and "terms" not in target.carries:
        polynomial = span is not None and "bias temperature" in target.carries
        thermal = [term for term in whole.terms if term.thermal and not (polynomial and term.of_bias)]
        for what, group in (*_by_effect(TEMPERATURE, thermal), *_by_effect(NONLINEAR, _not_thermal(whole))):
            whole = at_temperature(whole, held_degc(whole, span), group)
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
    """Terms by the effect that they are of, with words for each group."""
    effects = dict.fromkeys(term.effect for term in terms)
    groups = [(effect, [term for term in terms if term.effect == effect]) for effect in effects]
    return [(f"{what} ({effect})" if effect else what, group) for effect, group in groups]


def thermal_part(calibration: Calibration) -> Calibration:
    """A calibration without the terms that temperature does not change: a sign that turns would count as a change."""
    return calibration.with_terms([term for term in calibration.terms if term.thermal])


def farthest_mg(
    first: Calibration, second: Calibration, temperatures_degc: Sequence[float], time_s: float | None = None
) -> float:
    """The largest difference of two calibrations' forces at 1 g over some temperatures, mg; drift terms at one time."""
    readings = attitudes() @ np.linalg.inv(first.matrix).T + first.bias

    def force(of: Calibration, degc: float) -> np.ndarray:
        return of.corrected(readings, degc, time_s)

    return 1e3 * max(float(np.max(np.abs(force(first, degc) - force(second, degc)))) for degc in temperatures_degc)


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
