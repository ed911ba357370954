"""Comparison of the measured specific force with the prompted position, and the probable mistake if they differ."""

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
    named = [f"alpha {step.alpha_deg:g}, beta {step.beta_deg:g}" for step in plan.steps]
    expected, wanted, nearest = plan.expected(position), named[position], int(np.argmax(plan.directions @ mean_g))
    size, off_deg = float(np.linalg.norm(mean_g)), angle_between_deg(mean_g, expected)
    if abs(size - 1) > plan.limits.magnitude:
        return Verdict(WRONG_POSITION, f"the readings add up to {size:.3f} g, not 1 g: check range and unit", off_deg)
    if off_deg <= plan.tolerance_deg:
        return Verdict("", "", off_deg)
    if previous is not None and angle_between_deg(mean_g, plan.expected(previous)) <= plan.tolerance_deg:
        return Verdict(NOT_TURNED, f"still at {named[previous]}: turn to {wanted}", off_deg)
    exchanges = {"x and y": [1, 0, 2], "x and z": [2, 1, 0], "y and z": [0, 2, 1]}
    explanations = {
        f"this looks like {named[nearest]}, not {wanted}": plan.expected(nearest),
        **{
            f"the sign of axis {axis} seems reversed": expected * sign
            for axis, sign in zip(AXES, 1 - 2 * np.eye(3), strict=True)
        },
        "all signs seem reversed": -expected,
        **{f"axes {axes} seem exchanged": expected[order] for axes, order in exchanges.items()},
    }
    # The angles at which an ideal instrument has this direction.
    x, y, z = (mean_g if plan.mount is None else plan.mount.T @ mean_g) / size
    alpha, beta = np.degrees(np.arctan2(y, z)) % 360, -np.degrees(np.arcsin(np.clip(x, -1, 1)))
    explanations[f"this looks like alpha {alpha:.1f}, beta {beta:.1f}, not {wanted}"] = mean_g
    found = (
        text for text, direction in explanations.items() if angle_between_deg(mean_g, direction) <= plan.tolerance_deg
    )
    return Verdict(WRONG_POSITION, next(found), off_deg)
