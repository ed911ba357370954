"""What was mixed up in setting up, found before anything is fitted: units, axes, angles, temperature and time.

What can be put right in one way only is put right and said; what cannot is refused, with the hypotheses that would explain it.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain
from tumblecal.chain.nominal import FreeAttitude
from tumblecal.data import PositionSet
from tumblecal.data.conditions import are_kelvin
from tumblecal.estimation.angle_correction import Mapped, as_intended, correct_angles, with_turns
from tumblecal.estimation.gross_reading_errors import (
    FACTORS,
    NEAR,
    correct_decimal_points,
    refuse_unmeasured,
    units_of_rows,
)
from tumblecal.estimation.problem import where_of
from tumblecal.estimation.quarter_turns import turn_of, turn_words
from tumblecal.estimation.setup_error import SetupError
from tumblecal.ground.axes import AXES
from tumblecal.ground.clocks import times_going_on
from tumblecal.ground.errors import InputError


# Where at least this share of the rows is of 1 g, the columns are in g.
_IN_G = 0.25
# The size of readings (g) that is no other unit's, and still some calibration's.
_POSSIBLE_G = (0.5, 2.0)
# So many of an axis' readings are no larger than the size by which it is judged: one that is far off does not decide.
_MOST_IN_G = 0.9
# An axis that varies by less than this share of the others, or differs from another by less, has no signal of its own.
_NO_SIGNAL = 0.02
# An axis of which attitudes leave more than this share unexplained does not follow them.
_UNFOLLOWED = 0.5
# Ideal inputs of an axis must vary by this much (g) for it to be missed.
_MOVED_G = 0.5
# 0 degC in kelvin.
_ICE_POINT_K = 273.15
# Clocks that start within this share of a step of one another were both set to the start of their run.
_SAME_START = 0.1


def correct_setup_errors(data: PositionSet, chain: Chain | None = None) -> tuple[PositionSet, list[SetupError]]:
    """Find what was mixed up by comparing the readings with those of a perfect instrument, and put it right.

    **Arguments:**

    - `data`: as given, readings taken for g. `chain`: the model given for them, with the intended attitudes of the
      mountings; None for the default one.

    **Returns:** the set put right, and what was found.

    **Raises:** `InputError` for what cannot be put right in one way: an axis without a signal of its own, readings of
    no known unit, angles that the readings do not follow.
    """
    mended, setup_errors = _mended(data, chain)
    if chain is not None and where_of(mended).labels != where_of(data).labels:
        raise InputError(
            f"{data.source}: {setup_errors[-1].description}; correct the file, because the given model "
            "numbers the pitch settings as the file lists them"
        )
    return mended, setup_errors


def _mended(data: PositionSet, chain: Chain | None) -> tuple[PositionSet, list[SetupError]]:
    data, setup_errors = _conditions(data)
    for put_in_g in (_in_g, units_of_rows, _refuse_unknown_unit, correct_decimal_points):
        data, slips = put_in_g(data)
        setup_errors += slips
    if data.hand_held or (chain is not None and any(isinstance(link, FreeAttitude) for link in chain.links)):
        return data, setup_errors
    data, attitudes, slips = with_turns(data, chain)
    ideal = as_intended(data, attitudes)
    _refuse_silent_axes(data, ideal)
    axis_units, axis_map = _axes(data, ideal)
    if axis_units:
        data, slips = replace(data, readings=axis_units[0]), [*slips, *axis_units[1]]
    data, of_angles = correct_angles(data, chain, attitudes, axis_map)
    refuse_unmeasured(data)
    return data, [*setup_errors, *slips, *of_angles]


def _conditions(data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
    """Temperature in degC, and a time that goes on."""
    setup_errors: list[SetupError] = []
    temperature, time = data.temperature_degc, data.time_s
    if temperature is not None and are_kelvin(temperature):
        words = f"the temperatures, {np.min(temperature):.4g} to {np.max(temperature):.4g}, are kelvin"
        data, setup_errors = (
            replace(data, temperature_degc=temperature - _ICE_POINT_K),
            [SetupError("temperature_unit", words)],
        )
    if time is not None and (parts := _restarted(time)):
        firsts = np.cumsum([len(part) for part in parts])[:-1]
        words = (
            f"time_s starts again at position {', '.join(data.names[row] for row in firsts[:6])}; the pause before it is taken "
            "as one of unknown length"
        )
        part = np.searchsorted(firsts, np.arange(len(time)), side="right")
        clock = tuple(f"{own}.{number}" for own, number in zip(data.clock or ("1",) * len(time), part, strict=True))
        data = replace(data, time_s=times_going_on(parts), clock=clock)
        # Runs that have a clock each are no slip.
        if data.run is None or not np.array_equal(firsts, _changes(data.run)):
            setup_errors.append(SetupError("time_restarts", words))
    return data, setup_errors


def _changes(labels: Sequence[str]) -> list[int]:
    """The rows of which the label is another than that of the row before."""
    return [row for row, (before, label) in enumerate(pairwise(labels), start=1) if before != label]


def _restarted(time: Float[np.ndarray, " positions"]) -> list[np.ndarray]:
    """The stretches of a clock that was set back for each; empty where it was not.

    Rows in another order than they were measured in go back in time as well, but not to the same start.
    """
    back = np.flatnonzero(np.diff(time) < 0) + 1
    if not 0 < len(back) <= len(time) // 4:
        return []
    parts = np.split(time, back)
    step = float(np.median(np.concatenate([np.diff(part) for part in parts])))
    starts = np.array([part[0] for part in parts])
    return parts if np.max(np.abs(starts - starts[0])) <= _SAME_START * step else []


def _in_g(data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
    """The set in g where all readings are in one other unit."""
    sizes = np.linalg.norm(data.readings, axis=1)
    common = float(np.median(sizes))
    if np.mean(np.abs(np.log(np.maximum(sizes, 1e-300))) < np.log(NEAR)) < _IN_G:
        for words, factor in FACTORS.items():
            if 1 / NEAR < common / factor < NEAR:
                return replace(data, readings=data.readings / factor), [
                    SetupError("unit_error", f"all readings are in {words}")
                ]
    return data, []


def _refuse_unknown_unit(data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
    """The set as it is.

    **Raises:** `InputError` for readings in no known unit.
    """
    # Single axes in another unit change the size as well: only where all axes are off is there nothing to go by.
    largest = np.quantile(np.abs(data.readings), _MOST_IN_G, axis=0)
    if not np.any((largest > _POSSIBLE_G[0]) & (largest < _POSSIBLE_G[1])):
        raise InputError(
            f"{data.source}: the readings' size is about {np.median(np.linalg.norm(data.readings, axis=1)):.4g}; at rest it is "
            "1 g. If they are counts, divide them by the counts per g of the data sheet; else check the scale of the data"
        )
    return data, []


def _refuse_silent_axes(data: PositionSet, ideal: Float[np.ndarray, "positions 3"]) -> None:
    """Refuse an axis that does not move, or that reads what another reads.

    **Raises:** `InputError` naming the axes.
    """
    moved, readings = np.ptp(data.readings, axis=0), data.readings
    if np.any(np.ptp(ideal, axis=0) < _MOVED_G) or len(data) < 4:
        return
    usual = np.median(moved)
    for axis in np.flatnonzero(moved < _NO_SIGNAL * usual).tolist():
        if not _follows(readings[:, axis], ideal):
            raise InputError(
                f"{data.source}: axis {AXES[axis]} reads {readings[0, axis]:.4g} g at every position (it varies by "
                f"{moved[axis]:.2g} g, the others by {usual:.3g} g): a dead axis, or a column that is not a reading"
            )
    for first, second in ((0, 1), (0, 2), (1, 2)):
        for sign, words in ((1, "the same as"), (-1, "the negative of")):
            apart = np.ptp(readings[:, second] - sign * readings[:, first])
            if apart < _NO_SIGNAL * max(moved[first], moved[second]):
                raise InputError(
                    f"{data.source}: axis {AXES[second]} reads {words} axis {AXES[first]} at every position: a channel or a "
                    "column was taken twice; give each axis its own"
                )


def _follows(readings: Float[np.ndarray, " positions"], ideal: Float[np.ndarray, "positions 3"]) -> bool:
    """Whether one axis, however little it moves, follows the attitudes."""
    basis = np.hstack([ideal, np.ones((len(ideal), 1))])
    left = np.std(readings - basis @ np.linalg.lstsq(basis, readings, rcond=None)[0])
    return bool(np.ptp(readings) > 0 and left < _UNFOLLOWED * np.std(readings))


def _axes(
    data: PositionSet, ideal: Float[np.ndarray, "positions 3"]
) -> tuple[tuple[Float[np.ndarray, "positions 3"], list[SetupError]] | None, Mapped | None]:
    """Readings with single axes put in g, and readings on the plan's axes, where either is needed and can be told."""
    basis = np.hstack([ideal, np.ones((len(ideal), 1))])
    if np.linalg.matrix_rank(basis, tol=1e-3) < 4:
        return None, None
    readings, setup_errors = data.readings.copy(), []
    matrix = np.linalg.lstsq(basis, readings, rcond=None)[0][:3].T
    # Row a: which ideal inputs output a follows.
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
    turn, right = np.zeros((3, 3)), np.empty_like(readings)
    turn[np.arange(3), source] = np.sign(leading)
    right[:, source] = np.sign(leading) * readings
    terms = [f"column {AXES[a]} is {'-' if leading[a] < 0 else ''}{AXES[source[a]]}" for a in range(3)]
    angles = turn_of(turn + 0.0)
    turned = (
        () if angles is None else (("triad_turned", f"the triad stands turned {turn_words(angles)} in its fixture"),)
    )
    return united, (right, SetupError("axis_map", "; ".join(terms), turned))
