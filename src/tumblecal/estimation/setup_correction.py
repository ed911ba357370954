"""Set-up errors found before the fit: units, axes, angles, temperature and time.

An error with a unique correction is corrected and reported. Any other is rejected with the hypotheses that would explain it.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain
from tumblecal.chain.nominal import FreeAttitude
from tumblecal.data import PositionSet
from tumblecal.data.conditions import are_kelvin
from tumblecal.data.gravity_size import FACTORS, NEAR, gravity_size, moving_fault, size_fault, unit_of
from tumblecal.estimation.angle_correction import Mapped, as_intended, correct_angles, with_turns
from tumblecal.estimation.gross_reading_errors import correct_decimal_points, refuse_unmeasured, units_of_rows
from tumblecal.estimation.mountings import turn_of, turn_words
from tumblecal.estimation.position_problem import where_of
from tumblecal.estimation.setup_error import SetupError
from tumblecal.ground.axes import AXES
from tumblecal.ground.clocks import continued_times
from tumblecal.ground.errors import InputError


# If at least this share of the rows has a norm of 1 g, the columns are in g.
_IN_G = 0.25
# Sizes of readings (g) that a calibration may have and no other unit would produce.
_POSSIBLE_G = (0.5, 2.0)
# Readings in another unit are larger by more than this factor.
_OTHER_UNIT = 3.0
# An axis is judged by this quantile of its readings, so that a single outlier does not decide.
_MOST_IN_G = 0.9
# An axis that varies by less than this share of the others, or differs from another by less, has no separate signal.
_NO_SIGNAL = 0.02
# An axis does not follow the attitudes if they leave more than this share of it unexplained.
_UNFOLLOWED = 0.5
# A missing signal is reported only if the ideal inputs of the axis vary by this much (g).
_MOVED_G = 0.5
# 0 degC in kelvin.
_ICE_POINT_K = 273.15
# Clocks that start within this share of a step of one another were both set to the start of their run.
_SAME_START = 0.1


def correct_setup_errors(data: PositionSet, chain: Chain | None = None) -> tuple[PositionSet, list[SetupError]]:
    """Find set-up errors by comparison with the readings of a perfect instrument, and correct them.

    **Arguments:**

    - `data`: as given, readings assumed to be in g. `chain`: the given model with the intended attitudes of the mountings;
      None for the default model.

    **Returns:** the corrected set, and the errors found.

    **Raises:** `InputError` for errors without a unique correction: an axis without a separate signal, readings in an unknown
    unit, angles that the readings do not follow.
    """
    corrected, setup_errors = _corrected(data, chain)
    if chain is not None and where_of(corrected).labels != where_of(data).labels:
        raise InputError(
            f"{data.source}: {setup_errors[-1].description}; correct the file, because the given model "
            "numbers the pitch settings as the file lists them"
        )
    return corrected, setup_errors


def _corrected(data: PositionSet, chain: Chain | None) -> tuple[PositionSet, list[SetupError]]:
    data, setup_errors = _conditions(data)
    for correct in (_in_g, units_of_rows, correct_decimal_points):
        data, found = correct(data)
        setup_errors += found
    if data.hand_held and (fault := moving_fault(data)):
        raise InputError(f"{data.source}: {fault}")
    if data.hand_held or (chain is not None and any(isinstance(link, FreeAttitude) for link in chain.links)):
        return data, setup_errors
    data, attitudes, found = with_turns(data, chain)
    ideal = as_intended(data, attitudes)
    _refuse_silent_axes(data, ideal)
    axis_units, axis_map = _axes(data, ideal)
    if axis_units:
        data, found = replace(data, readings=axis_units[0]), [*found, *axis_units[1]]
    data, of_angles = correct_angles(data, chain, attitudes, axis_map)
    refuse_unmeasured(data)
    return data, [*setup_errors, *found, *of_angles]


def _conditions(data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
    """The set with temperatures in degC and times that increase through the file."""
    setup_errors: list[SetupError] = []
    temperature, time = data.temperature_degc, data.time_s
    if temperature is not None and are_kelvin(temperature):
        words = f"the temperatures, {np.min(temperature):.4g} to {np.max(temperature):.4g}, are in kelvin"
        data, setup_errors = (
            replace(data, temperature_degc=temperature - _ICE_POINT_K),
            [SetupError("temperature_unit", words)],
        )
    if time is not None and (parts := _restarted(time)):
        firsts = np.cumsum([len(part) for part in parts])[:-1]
        words = (
            f"time_s restarts at position {', '.join(data.names[row] for row in firsts[:6])}; the pause before it is "
            "assumed to "
            "have an unknown length"
        )
        part = np.searchsorted(firsts, np.arange(len(time)), side="right")
        clock = tuple(f"{label}.{number}" for label, number in zip(data.clock or ("1",) * len(time), part, strict=True))
        data = replace(data, time_s=continued_times(parts), clock=clock)
        # One clock for each run is no error.
        labels = data.run or ()
        changes = [row for row, (before, label) in enumerate(pairwise(labels), start=1) if before != label]
        if data.run is None or not np.array_equal(firsts, changes):
            setup_errors.append(SetupError("time_restarts", words))
    return data, setup_errors


def _restarted(time: Float[np.ndarray, " positions"]) -> list[np.ndarray]:
    """The parts of the times between resets of the clock; empty if it was not reset.

    Times also decrease if the rows are not in measuring order, but then not to the same start.
    """
    back = np.flatnonzero(np.diff(time) < 0) + 1
    if not 0 < len(back) <= len(time) // 4:
        return []
    parts = np.split(time, back)
    step = float(np.median(np.concatenate([np.diff(part) for part in parts])))
    starts = np.array([part[0] for part in parts])
    return parts if np.max(np.abs(starts - starts[0])) <= _SAME_START * step else []


def _in_g(data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
    """The set in g, if all readings are in one other unit.

    **Raises:** `InputError` for readings of another size than gravity.
    """
    sizes = np.linalg.norm(data.readings, axis=1)
    in_g = np.mean(np.abs(np.log(np.maximum(sizes, 1e-300))) < np.log(NEAR)) >= _IN_G
    if not in_g and (unit := unit_of(gravity_size(data.readings))):
        return replace(data, readings=data.readings / FACTORS[unit]), [
            SetupError("unit_error", f"all readings are in {unit}")
        ]
    # Some rows, or a single axis, in another unit change the size as well; they are corrected later.
    largest = np.quantile(np.abs(data.readings), _MOST_IN_G, axis=0)
    one_axis = np.max(largest) > _OTHER_UNIT * np.min(largest) and np.any(
        (largest > _POSSIBLE_G[0]) & (largest < _POSSIBLE_G[1])
    )
    if not (one_axis or (in_g and np.max(sizes) > _OTHER_UNIT)) and (fault := size_fault(data.readings)):
        raise InputError(f"{data.source}: {fault}")
    return data, []


def _refuse_silent_axes(data: PositionSet, ideal: Float[np.ndarray, "positions 3"]) -> None:
    """Reject an axis that does not vary, or whose readings equal those of another.

    **Raises:** `InputError` naming the axes.
    """
    moved, readings = np.ptp(data.readings, axis=0), data.readings
    if np.any(np.ptp(ideal, axis=0) < _MOVED_G) or len(data) < 4:
        return
    usual, basis = np.median(moved), np.hstack([ideal, np.ones((len(ideal), 1))])
    for axis in np.flatnonzero(moved < _NO_SIGNAL * usual).tolist():
        # Whether the axis follows the attitudes, however little it varies.
        residual_sd = np.std(readings[:, axis] - basis @ np.linalg.lstsq(basis, readings[:, axis], rcond=None)[0])
        if not (moved[axis] > 0 and residual_sd < _UNFOLLOWED * np.std(readings[:, axis])):
            raise InputError(
                f"{data.source}: axis {AXES[axis]} reads {readings[0, axis]:.4g} g at every position (it varies by "
                f"{moved[axis]:.2g} g, the others by {usual:.3g} g): a dead axis, or a column without readings; check the "
                "sensor and the column names"
            )
    for first, second in ((0, 1), (0, 2), (1, 2)):
        for sign, words in ((1, "the same as"), (-1, "the negative of")):
            difference = np.ptp(readings[:, second] - sign * readings[:, first])
            if difference < _NO_SIGNAL * max(moved[first], moved[second]):
                raise InputError(
                    f"{data.source}: axis {AXES[second]} reads {words} axis {AXES[first]} at every position: a channel or a "
                    "column was used twice; give each axis its column"
                )


def _axes(
    data: PositionSet, ideal: Float[np.ndarray, "positions 3"]
) -> tuple[tuple[Float[np.ndarray, "positions 3"], list[SetupError]] | None, Mapped | None]:
    """Readings with single axes converted to g, and readings on the plan's axes; None for either if not needed or unclear."""
    basis = np.hstack([ideal, np.ones((len(ideal), 1))])
    if np.linalg.matrix_rank(basis, tol=1e-3) < 4:
        return None, None
    readings, setup_errors = data.readings.copy(), []
    matrix = np.linalg.lstsq(basis, readings, rcond=None)[0][:3].T
    # For each output, the ideal input that it follows.
    source = np.argmax(np.abs(matrix), axis=1)
    leading = matrix[np.arange(3), source]
    if len(set(source.tolist())) < 3 or (np.any(np.abs(leading) < 0.5) and not np.any(np.abs(leading) > 2)):
        return None, None
    for axis in range(3):
        for words, factor in FACTORS.items():
            if 1 / NEAR < abs(leading[axis]) / factor < NEAR:
                readings[:, axis] /= factor
                setup_errors.append(SetupError("unit_error", f"axis {AXES[axis]} is in {words}"))
    united = (readings, setup_errors) if setup_errors else None
    if not (np.any(source != np.arange(3)) or np.any(leading < 0)):
        return united, None
    turn, remapped = np.zeros((3, 3)), np.empty_like(readings)
    turn[np.arange(3), source] = np.sign(leading)
    remapped[:, source] = np.sign(leading) * readings
    terms = [f"column {AXES[a]} is {'-' if leading[a] < 0 else ''}{AXES[source[a]]}" for a in range(3)]
    angles = turn_of(turn + 0.0)
    turned = () if angles is None else (("triad_turned", f"the triad is turned {turn_words(angles)} in its fixture"),)
    return united, (remapped, SetupError("axis_map", "; ".join(terms), turned))
