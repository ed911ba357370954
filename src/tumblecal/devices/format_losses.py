"""Losses of the format of a target: the largest error at 1 g in any attitude, by cause, over the temperature range."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.devices.over_temperature import export_degc, temperatures
from tumblecal.devices.target import DRIFT, TEMPERATURE, Export, Target, reductions


# Number of attitudes for losses: a lattice on the sphere (Fibonacci), in addition to both directions of the axes.
_ATTITUDES = 400
# A smaller loss (mg) is due to rounding, and is not reported.
_NOTHING_MG = 1e-4
_HOUR_S = 3600.0
_ROUNDING = "rounding of the numbers in the file"


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
    span, run_s, rows = export.temperatures_degc, export.run_s, export.table_degc
    grid = np.union1d(temperatures(whole, span), rows[1:] - np.diff(rows) / 2)
    reference = export_degc(whole, span, export.at_degc)
    starts = {term.reference_s for term in whole.terms if term.per_hour}
    start_s, end_s = min(starts, default=0.0), max(starts, default=0.0) + (_HOUR_S if run_s is None else run_s)
    over_span = "at its reference temperature" if span is None else f"from {span[0]:g} to {span[1]:g} degC"
    lost, before = list[Loss](), whole
    for what, after in _on_the_way(target, export, whole, text):
        first, second, degc, time_s, per = before, after, [reference], start_s, ""
        if what.startswith(DRIFT):
            degc, time_s, per = grid, end_s, "h" if run_s is None else ""
            what += "" if run_s is None else f", over {run_s / _HOUR_S:.3g} h"
        elif what.startswith(TEMPERATURE):
            # Only the thermal terms, because a change of sign in another term would look like a thermal change.
            first, second = (each.with_terms([t for t in each.terms if t.thermal]) for each in (before, after))
            degc, per = ([reference + 1.0], "degC") if span is None else (grid, "")
            what += "" if span is None else f", {over_span}"
        elif what == _ROUNDING:
            degc = grid
        lost.append(Loss(what, farthest_mg(first, second, degc, time_s), per))
        before = after
    lost = [loss for loss in lost if loss.mg > _NOTHING_MG]
    if sum(not loss.per for loss in lost) > 1:
        total = farthest_mg(whole, before, grid, start_s if run_s is None else end_s)
        lost.append(Loss(f"in total, {over_span}", total))
    if target.held_degc is not None and span is not None and "temperature_degc" in before.columns_needed:
        step, words = target.held_degc
        held = farthest_mg(before, before, grid[grid + step <= span[1]], start_s, lag_degc=step)
        lost.append(Loss(f"in addition, {words}", held))
    return lost


def _on_the_way(target: Target, export: Export, whole: Calibration, text: str) -> Iterator[tuple[str, Calibration]]:
    """The steps from a calibration to the device: words for each step, and the calibration after it."""
    carried, device = whole, target.on_device
    for what, carried in reductions(target, whole, export.temperatures_degc, export.at_degc):
        yield what, carried
    if device is not None:
        used, words = device(carried, export)
        yield words, used
    read = target.read(text, export.gravity_ms2)
    yield _ROUNDING, read if device is None else device(read, export)[0]


def farthest_mg(
    first: Calibration,
    second: Calibration,
    temperatures_degc: Sequence[float] | np.ndarray,
    time_s: float,
    *,
    lag_degc: float = 0.0,
) -> float:
    """The largest difference of the forces of two calibrations at 1 g over some temperatures, mg; drift terms at one time. The
    second is applied at temperatures that are higher by `lag_degc`."""
    directions, degc = attitudes(), np.array(temperatures_degc, float)
    readings = np.tile(directions @ np.linalg.inv(first.matrix).T + first.bias, (len(degc), 1))
    degc = np.repeat(degc, len(directions))
    force = first.corrected(readings, degc, time_s, extrapolate=True)
    return 1e3 * float(np.max(np.abs(force - second.corrected(readings, degc + lag_degc, time_s, extrapolate=True))))


def attitudes() -> Float[np.ndarray, "attitudes 3"]:
    """Directions of gravity: a Fibonacci lattice on the unit sphere, and both directions of the axes."""
    k = np.arange(_ATTITUDES) + 0.5
    z, turn = 1 - 2 * k / _ATTITUDES, np.pi * (1 + np.sqrt(5)) * k
    lattice = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    return np.concatenate([lattice, np.eye(3), -np.eye(3)])
