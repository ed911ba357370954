"""Comparison of the measured specific force with the prompted position, and the probable mistake if they differ."""

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.ground.axes import AXES
from tumblecal.ground.frames import angle_between_deg


NOT_TURNED, WRONG_POSITION = "not_turned", "wrong_position"


class Verdict(NamedTuple):
    """The result for a mean.

    **Arguments:**

    - `fault`: entry of the journal: `NOT_TURNED` or `WRONG_POSITION`; empty if it fits.
    - `text`: message for the operator; empty if it fits.
    - `off_deg`: angle between the measured and the expected direction.
    """

    fault: str
    text: str
    off_deg: float


def judge(plan: CapturePlan, position: int, mean_g: NDArray[np.float64], previous: int | None = None) -> Verdict:
    """Compare a mean with the nominal chain; the first explanation within the tolerance is the verdict.

    **Arguments:**

    - `plan`: the positions.
    - `position`: the prompted position. `previous`: the position measured before.
    - `mean_g`: mean specific force in units of local gravity, shape (3,).
    """

    def named(k: int) -> str:
        return f"alpha {plan.steps[k].alpha_deg:g}, beta {plan.steps[k].beta_deg:g}"

    expected, size = plan.expected(position), float(np.linalg.norm(mean_g))
    off = angle_between_deg(mean_g, expected)
    if abs(size - 1) > plan.limits.magnitude:
        return Verdict(WRONG_POSITION, f"the readings add up to {size:.3f} g, not 1 g: check range and unit", off)
    wanted, nearest = named(position), int(np.argmax(plan.directions @ mean_g))
    explanations = [("", "", expected)]
    if previous is not None:
        explanations.append((NOT_TURNED, f"still at {named(previous)}: turn to {wanted}", plan.expected(previous)))
    explanations.append((WRONG_POSITION, f"this looks like {named(nearest)}, not {wanted}", plan.expected(nearest)))
    # One reversed axis, all of them, or two exchanged axes.
    changes = {f"the sign of axis {axis} seems reversed": np.diag(1 - 2 * np.eye(3)[k]) for k, axis in enumerate(AXES)}
    changes["all signs seem reversed"] = -np.eye(3)
    for first, second in combinations(range(3), 2):
        order = [{first: second, second: first}.get(k, k) for k in range(3)]
        changes[f"axes {AXES[first]} and {AXES[second]} seem exchanged"] = np.eye(3)[order]
    explanations += [(WRONG_POSITION, f"{words} at {wanted}", change @ expected) for words, change in changes.items()]
    for fault, text, direction in explanations:
        if angle_between_deg(mean_g, direction) <= plan.tolerance_deg:
            return Verdict(fault, text, off)
    # The angles at which an ideal instrument has this direction.
    x, y, z = (mean_g if plan.mount is None else plan.mount.T @ mean_g) / size
    alpha, beta = np.degrees(np.arctan2(y, z)) % 360, -np.degrees(np.arcsin(np.clip(x, -1, 1)))
    return Verdict(WRONG_POSITION, f"this looks like alpha {alpha:.1f}, beta {beta:.1f}, not {wanted}", off)
