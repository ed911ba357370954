"""Assignment of intervals at rest to positions of a plan, by the direction of gravity, in the plan's order or in any order."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.data.gravity_size import sphere_of


# Tolerance of a position before bias and scale are known: half the distance to the next direction, at most this.
_FAR_DEG = 30.0
# Directions closer than this are equal for gravity (for example all alpha at beta 90).
_SAME_DEG = 1.0
# Costs in the plan's order, in squared tolerances, of a skipped interval, a skipped position, and a repeated position.
_SURPLUS, _MISSING, _AGAIN = 1.5, 1.0, 0.3
# Fewest recognised positions for a bias and scale, and fewest readings for a centre.
_FEWEST_FOR_BIAS, _FEWEST_FOR_CENTRE = 6, 5


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
    def surplus(self) -> list[int]:
        """Intervals that are not positions of the plan."""
        return np.flatnonzero(self.positions < 0).tolist()

    def as_dict(self) -> dict[str, object]:
        """For a file: positions without an interval, and with several."""
        counts = np.bincount(self.positions[self.positions >= 0], minlength=len(self.names))
        missing, repeated = ([self.names[k] for k in np.flatnonzero(mask)] for mask in (counts == 0, counts > 1))
        return {"missing": missing, "repeated": repeated, "surplus": len(self.surplus), "in_order": self.in_order}

    def words(self) -> list[str]:
        """Missing and repeated positions, one line each."""
        lines = [] if self.in_order else ["the intervals are not in the plan's order: recognised only by direction"]
        found = self.as_dict()
        for words, key in (("missing", "missing"), ("measured again", "repeated")):
            lines += [f"{words}: {', '.join(names)}"] if (names := found[key]) else []
        return lines


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
        corrected = _without_bias(readings, expected, match.positions)
        match = match if corrected is None else _matched(corrected, expected, plan.tolerance_deg, names)
        sure = match.positions[(match.positions >= 0) & (match.angle_deg < plan.tolerance_deg)]
        found.append(((len(sure), len(np.unique(sure)), corrected is not None, match.in_order), match))
    return max(found, key=lambda one: one[0])[1]


def _centres(readings: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Candidate biases of the axes: zero; the middle of each axis' readings; the centre of a sphere through the readings.
    Offsets of 0.25 to 0.6 g, common in cheap sensors, turn directions by up to 30 degrees."""
    centres = [np.zeros(3)]
    if len(readings) >= _FEWEST_FOR_CENTRE:
        centres.append((readings.max(0) + readings.min(0)) / 2)
        design = np.column_stack([2 * readings, np.full(len(readings), np.abs(readings).max())])
        centres += [sphere_of(readings)[0]] if np.linalg.cond(design) < 100 else []
    return [centre for centre in centres if (readings != centre).any(1).all()]


def _matched(
    readings: NDArray[np.float64], expected: NDArray[np.float64], tolerance_deg: float, names: tuple[str, ...]
) -> PlanMatch:
    angles = _angles(readings, expected)
    # In any order: the nearest direction of each interval; positions with equal directions are assigned in order.
    same = _angles(expected, expected) < _SAME_DEG
    any_order = np.full(len(angles), -1)
    for interval in np.flatnonzero(angles.min(1) < tolerance_deg):
        candidates = np.flatnonzero(same[angles[interval].argmin()])
        any_order[interval] = next((k for k in candidates if k not in any_order), candidates[-1])
    in_order = _in_order(np.where(angles < tolerance_deg, (angles / tolerance_deg) ** 2, np.inf))
    explained = [((each >= 0).sum(), len(np.unique(each))) for each in (in_order, any_order)]
    ordered = explained[0] >= explained[1]
    return PlanMatch(in_order if ordered else any_order, angles.min(1), ordered, names)


def _angles(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles between the rows of two lists, deg."""
    units = [rows / np.linalg.norm(rows, axis=1, keepdims=True) for rows in (a, b)]
    return np.degrees(np.arccos(np.clip(units[0] @ units[1].T, -1.0, 1.0)))


def _in_order(cost: NDArray[np.float64]) -> NDArray[np.int64]:
    """The alignment of intervals (rows) with the plan (columns) of lowest cost, by dynamic programming: the position of each
    interval, -1 for none."""
    totals, moves = (_MISSING * np.arange(cost.shape[1] + 1)).tolist(), list[list[str]]()
    for row in cost.tolist():
        best = [(totals[0] + _SURPLUS, "surplus")]
        for j, price in enumerate(row, start=1):
            choices = [(totals[j] + _SURPLUS, "surplus"), (totals[j - 1] + price, "next")]
            if moves and moves[-1][j] in ("next", "again"):
                choices.append((totals[j] + price + _AGAIN, "again"))
            choice = min(choices, key=lambda one: one[0])
            # The earlier of positions with equal directions.
            missing = best[-1][0] + _MISSING
            best.append((missing, "missing") if missing < choice[0] + 1e-6 else choice)
        totals = [total for total, _ in best]
        moves.append([move for _, move in best])
    positions, j = np.full(len(cost), -1), cost.shape[1]
    for i in reversed(range(len(cost))):
        while moves[i][j] == "missing":
            j -= 1
        if moves[i][j] != "surplus":
            positions[i] = j - 1
        j -= moves[i][j] == "next"
    return positions


def _without_bias(
    readings: NDArray[np.float64], expected: NDArray[np.float64], positions: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """The readings in the plan's axes, by the affine map from the recognised intervals; None if they do not determine it."""
    known = positions >= 0
    design = np.column_stack([expected[positions[known]], np.ones(int(known.sum()))])
    if len(np.unique(positions[known])) < _FEWEST_FOR_BIAS or np.linalg.cond(design) > 100:
        return None
    solution = np.linalg.lstsq(design, readings[known], rcond=None)[0]
    return (readings - solution[3]) @ np.linalg.inv(solution[:3]) if np.linalg.cond(solution[:3]) <= 3 else None
