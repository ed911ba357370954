"""Assignment of intervals at rest to positions of a plan, by the direction of gravity, in the plan's order or in any order."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.data.gravity_size import sphere_of
from tumblecal.recordings.still.rough_sensor import rough_sensor


# Tolerance of a position before bias and scale are known: half the distance to the next direction, at most this.
_FAR_DEG = 30.0
# Directions closer than this are equal for gravity (for example all alpha at beta 90).
_SAME_DEG = 1.0
# Costs in the plan's order, in squared tolerances, of a skipped interval, a skipped position, and a repeated position.
_SURPLUS, _MISSING, _AGAIN = 1.5, 1.0, 0.3
# Bias and scale are removed before the second pass if at least this many intervals were recognised.
_FEWEST_FOR_BIAS = 6
_FEWEST_FOR_CENTRE = 5


@dataclass(frozen=True)
class PlanMatch:
    """The position of each interval.

    **Arguments:**

    - `positions`: index in the plan, by interval; -1 for none (surplus). `names`: names of the plan's positions.
    - `angle_deg`: angle to the nearest direction of the plan. `in_order`: whether the intervals are in the plan's order.
    """

    positions: NDArray[np.int64]
    angle_deg: NDArray[np.float64]
    in_order: bool
    names: tuple[str, ...]

    @property
    def missing(self) -> list[str]:
        """Positions of the plan without an interval."""
        return [name for k, name in enumerate(self.names) if k not in self.positions]

    @property
    def repeated(self) -> list[str]:
        """Positions with several intervals."""
        indices, counts = np.unique(self.positions[self.positions >= 0], return_counts=True)
        return [self.names[k] for k in indices[counts > 1]]

    @property
    def surplus(self) -> list[int]:
        """Intervals that are not positions of the plan."""
        return np.flatnonzero(self.positions < 0).tolist()

    def as_dict(self) -> dict[str, object]:
        """For a file."""
        entries: dict[str, object] = {"missing": self.missing, "repeated": self.repeated, "surplus": len(self.surplus)}
        return entries | {"in_order": self.in_order}

    def words(self) -> list[str]:
        """Missing and repeated positions, one line each."""
        lines = [] if self.in_order else ["the intervals are not in the plan's order: recognised only by direction"]
        lines += [f"missing: {', '.join(self.missing)}"] if self.missing else []
        return lines + ([f"measured again: {', '.join(self.repeated)}"] if self.repeated else [])


def matched(readings: NDArray[np.float64], plan: CapturePlan) -> PlanMatch:
    """Recognise intervals: in the plan's order if this explains as many of them as any order does.

    **Arguments:**

    - `readings`: means of the intervals in time, any unit, shape (n, 3).
    """
    expected = np.array([plan.expected(k) for k in range(len(plan.steps))])
    separations = _angles(expected, expected)
    tolerance = min([0.5 * angle for angle in separations[separations > _SAME_DEG]] + [_FAR_DEG])
    names = tuple(str(step.name) for step in plan.steps)
    found = []
    for centre in _centres(readings):
        match = _matched(readings - centre, expected, tolerance, names)
        corrected = _without_bias(readings, expected, match)
        match = match if corrected is None else _matched(corrected, expected, plan.tolerance_deg, names)
        sure = match.positions[(match.positions >= 0) & (match.angle_deg < plan.tolerance_deg)]
        found.append(((len(sure), len(set(sure.tolist())), corrected is not None, match.in_order), match))
    return max(found, key=lambda one: one[0])[1]


def _centres(readings: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Candidate biases of the axes: zero; the middle of each axis' readings; the centres of a sphere and an ellipsoid through
    the readings. Offsets of 0.25 to 0.6 g, common in cheap sensors, turn directions by up to 30 degrees."""
    if len(readings) < _FEWEST_FOR_CENTRE:
        return [np.zeros(3)]
    centres = [np.zeros(3), (readings.max(0) + readings.min(0)) / 2]
    design = np.column_stack([2 * readings, np.full(len(readings), np.abs(readings).max())])
    if np.linalg.cond(design) < 100:
        centres.append(sphere_of(readings)[0])
    sensor = rough_sensor(readings)
    centres += [sensor.centre] if sensor else []
    return [centre for centre in centres if (readings != centre).any(1).all()]


def _matched(
    readings: NDArray[np.float64], expected: NDArray[np.float64], tolerance_deg: float, names: tuple[str, ...]
) -> PlanMatch:
    angles = _angles(readings, expected)
    in_order, any_order = _in_order(angles, tolerance_deg), _in_any_order(angles, expected, tolerance_deg)

    def explained(positions: NDArray[np.int64]) -> tuple[int, int]:
        return int((positions >= 0).sum()), len(set(positions.tolist()))

    ordered = explained(in_order) >= explained(any_order)
    return PlanMatch(in_order if ordered else any_order, angles.min(1), ordered, names)


def _angles(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles between the rows of two lists, deg."""
    units = [rows / np.linalg.norm(rows, axis=1, keepdims=True) for rows in (a, b)]
    return np.degrees(np.arccos(np.clip(units[0] @ units[1].T, -1.0, 1.0)))


def _in_order(angles: NDArray[np.float64], tolerance_deg: float) -> NDArray[np.int64]:
    """The alignment of intervals (rows) with the plan (columns) of lowest cost, by dynamic programming."""
    n, m = angles.shape
    cost = np.where(angles < tolerance_deg, (angles / tolerance_deg) ** 2, np.inf)
    total = np.full((n + 1, m + 1), np.inf)
    total[0] = _MISSING * np.arange(m + 1)
    move = np.zeros((n + 1, m + 1), np.int8)
    for i in range(1, n + 1):
        total[i, 0] = total[i - 1, 0] + _SURPLUS
        again = np.concatenate([[np.inf], total[i - 1, 1:] + cost[i - 1] + _AGAIN])
        choices = np.array([
            total[i - 1] + _SURPLUS,
            np.concatenate([[np.inf], total[i - 1, :-1] + cost[i - 1]]),
            np.where(np.isin(move[i - 1], (1, 2)), again, np.inf),
        ])  # fmt: skip
        move[i] = choices.argmin(0)
        total[i] = choices.min(0)
        for j in range(1, m + 1):
            # The earlier of positions with equal directions.
            if total[i, j - 1] + _MISSING < total[i, j] + 1e-6:
                total[i, j], move[i, j] = total[i, j - 1] + _MISSING, 3
    positions = np.full(n, -1)
    i, j = n, m
    while i > 0:
        step = move[i, j]
        if step == 3:
            j -= 1
            continue
        if step in (1, 2):
            positions[i - 1] = j - 1
        i, j = i - 1, j - (step == 1)
    return positions


def _in_any_order(
    angles: NDArray[np.float64], expected: NDArray[np.float64], tolerance_deg: float
) -> NDArray[np.int64]:
    """The nearest direction of each interval; positions with equal directions are assigned in order."""
    same = _angles(expected, expected) < _SAME_DEG
    used: set[int] = set()
    positions = np.full(len(angles), -1)
    for interval, row in enumerate(angles):
        nearest = int(row.argmin())
        if row[nearest] >= tolerance_deg:
            continue
        candidates = np.flatnonzero(same[nearest])
        free = [int(position) for position in candidates if position not in used]
        positions[interval] = free[0] if free else int(candidates[-1])
        used.add(int(positions[interval]))
    return positions


def _without_bias(
    readings: NDArray[np.float64], expected: NDArray[np.float64], match: PlanMatch
) -> NDArray[np.float64] | None:
    """The readings in the plan's axes, by the affine map from the recognised intervals; None if they do not determine it."""
    matched = match.positions >= 0
    design = np.column_stack([expected[match.positions[matched]], np.ones(int(matched.sum()))])
    if len(set(match.positions[matched].tolist())) < _FEWEST_FOR_BIAS or np.linalg.cond(design) > 100:
        return None
    solution, *_ = np.linalg.lstsq(design, readings[matched], rcond=None)
    if np.linalg.cond(solution[:3]) > 3:
        return None
    return (readings - solution[3]) @ np.linalg.inv(solution[:3])
