"""Assignment of intervals at rest to positions of a plan, by the direction of gravity, in the plan's order or in any order."""

from dataclasses import dataclass

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.decoding.samples import Floats, Integers
from tumblecal.data.gravity_size import sphere_of


# Tolerance of a position before bias and scale are known: half the distance to the next direction, at most this.
_FAR_DEG = 30.0
# Directions closer than this are equal for gravity (for example all alpha at beta 90).
_SAME_DEG = 1.0
# Fewest recognised positions for a bias and scale, and fewest readings for a centre.
_FEWEST_FOR_BIAS, _FEWEST_FOR_CENTRE = 6, 5


@dataclass(frozen=True)
class PlanMatch:
    """The position of each interval.

    **Arguments:**

    - `positions`: index in the plan, by interval; -1 for none (surplus). `names`: names of the plan's positions.
    - `angle_deg`: angle to the nearest direction of the plan. `in_order`: whether the intervals are in the plan's order.
    - `same_direction`: positions with that direction, by interval; none if it is too far away.
    """

    positions: Integers
    angle_deg: Floats
    in_order: bool
    names: tuple[str, ...]
    same_direction: list[list[int]]

    @property
    def surplus(self) -> list[int]:
        """Intervals that are not positions of the plan."""
        return np.flatnonzero(self.positions < 0).tolist()

    @property
    def missing(self) -> list[str]:
        """Positions without an interval."""
        return [name for k, name in enumerate(self.names) if not (self.positions == k).any()]

    @property
    def repeated(self) -> list[str]:
        """Positions with several intervals."""
        return [name for k, name in enumerate(self.names) if (self.positions == k).sum() > 1]

    @property
    def explained(self) -> tuple[int, int]:
        """Numbers of intervals with a position, and of different positions."""
        return int((self.positions >= 0).sum()), len(np.unique(self.positions))

    def words(self) -> list[str]:
        """Missing and repeated positions, one line each."""
        lines = [] if self.in_order else ["the intervals are not in the plan's order: recognised only by direction"]
        for words, found in (("missing", self.missing), ("measured again", self.repeated)):
            lines += [f"{words}: {', '.join(found)}"] if found else []
        return lines


def matched(readings: Floats, plan: CapturePlan) -> PlanMatch:
    """Recognise intervals: in the plan's order if this explains as many of them as any order does.

    **Arguments:**

    - `readings`: means of the intervals in time, any unit, shape (n, 3).
    """
    expected = np.array([plan.expected(k) for k in range(len(plan.steps))])
    separations = _angles(expected, expected)
    tolerance = min([0.5 * angle for angle in separations[separations > _SAME_DEG]] + [_FAR_DEG])
    names = tuple(str(step.name) for step in plan.steps)
    # Candidate biases: zero; the middle of each axis' readings; the centre of a sphere through the readings. Offsets of 0.25
    # to 0.6 g, common in cheap sensors, turn directions by up to 30 degrees.
    centres = [np.zeros(3)]
    if len(readings) >= _FEWEST_FOR_CENTRE:
        centres.append((readings.max(0) + readings.min(0)) / 2)
        design = np.column_stack([2 * readings, np.full(len(readings), np.abs(readings).max())])
        centres += [sphere_of(readings)[0]] if np.linalg.cond(design) < 100 else []
    found = []
    for centre in centres:
        if (readings == centre).all(1).any():
            continue
        match = _matched(readings - centre, expected, tolerance, names)
        corrected = _without_bias(readings, expected, match.positions)
        match = match if corrected is None else _matched(corrected, expected, plan.tolerance_deg, names)
        sure = match.positions[(match.positions >= 0) & (match.angle_deg < plan.tolerance_deg)]
        found.append(((len(sure), len(np.unique(sure)), corrected is not None, match.in_order), match))
    return max(found, key=lambda one: one[0])[1]


def _matched(readings: Floats, expected: Floats, tolerance_deg: float, names: tuple[str, ...]) -> PlanMatch:
    """The position of each interval among its candidates, which are equal for gravity: the first one after the last position,
    otherwise that position again; if not in order, the first one without an interval."""
    angles, same = _angles(readings, expected), _angles(expected, expected) < _SAME_DEG
    candidates = [np.flatnonzero(same[row.argmin()]).tolist() if row.min() < tolerance_deg else [] for row in angles]
    found = []
    for in_order in (True, False):
        positions, last = np.full(len(candidates), -1), -1
        for interval, each in enumerate(candidates):
            free = [k for k in each if (k > last if in_order else k not in positions)]
            if free or not in_order or last in each:
                last = (free or ([last] if in_order else each[-1:]) or [-1])[0]
                positions[interval] = last
        found.append(PlanMatch(positions, angles.min(1), in_order, names, candidates))
    return max(found, key=lambda one: one.explained)


def _angles(a: Floats, b: Floats) -> Floats:
    """Angles between the rows of two lists, deg."""
    units = [rows / np.linalg.norm(rows, axis=1, keepdims=True) for rows in (a, b)]
    return np.degrees(np.arccos(np.clip(units[0] @ units[1].T, -1.0, 1.0)))


def _without_bias(readings: Floats, expected: Floats, positions: Integers) -> Floats | None:
    """The readings in the plan's axes, by the affine map from the recognised intervals; None if they do not determine it."""
    known = positions >= 0
    design = np.column_stack([expected[positions[known]], np.ones(int(known.sum()))])
    if len(np.unique(positions[known])) < _FEWEST_FOR_BIAS or np.linalg.cond(design) > 100:
        return None
    solution = np.linalg.lstsq(design, readings[known], rcond=None)[0]
    return (readings - solution[3]) @ np.linalg.inv(solution[:3]) if np.linalg.cond(solution[:3]) <= 3 else None
