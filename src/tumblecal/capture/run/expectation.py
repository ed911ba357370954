"""Comparison of the measured specific force with the prompted position, and the probable mistake if they differ."""

from dataclasses import dataclass
from enum import Enum
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.ground.axes import AXES
from tumblecal.ground.frames import angle_between_deg


class Fault(Enum):
    """Possible faults of a position."""

    NOT_TURNED = "not turned"
    OTHER_POSITION = "other position"
    MAGNITUDE = "magnitude"
    SIGN = "sign"
    AXES = "axes"


@dataclass(frozen=True)
class Verdict:
    """The result for a mean.

    **Arguments:**

    - `fault`: None if it fits.
    - `text`: message for the operator; empty if it fits.
    - `off_deg`: angle between the measured and the expected direction.
    """

    fault: Fault | None
    text: str
    off_deg: float


def judge(plan: CapturePlan, position: int, mean_g: NDArray[np.float64], previous: int | None = None) -> Verdict:
    """Compare a mean with the nominal chain.

    **Arguments:**

    - `plan`: the positions.
    - `position`: the prompted position. `previous`: the position measured before.
    - `mean_g`: mean specific force in units of local gravity, shape (3,).
    """
    expected = plan.expected(position)
    size = float(np.linalg.norm(mean_g))
    off = angle_between_deg(mean_g, expected)
    if abs(size - 1) > plan.limits.magnitude:
        text = f"the size of the readings is {size:.3f} g, not 1 g: check range and unit (range {_range_hint(size)})"
        return Verdict(Fault.MAGNITUDE, text, off)
    if off <= plan.tolerance_deg:
        return Verdict(None, "", off)
    step = plan.steps[position]
    wanted = f"alpha {step.alpha_deg:g}, beta {step.beta_deg:g}"
    if previous is not None and angle_between_deg(mean_g, plan.expected(previous)) <= plan.tolerance_deg:
        like = plan.steps[previous]
        text = f"still at alpha {like.alpha_deg:g}, beta {like.beta_deg:g}: turn to {wanted}"
        return Verdict(Fault.NOT_TURNED, text, off)
    others = [(angle_between_deg(mean_g, plan.expected(k)), k) for k in range(len(plan.steps))]
    nearest, which = min(others)
    if nearest <= plan.tolerance_deg:
        like = plan.steps[which]
        text = f"this looks like alpha {like.alpha_deg:g}, beta {like.beta_deg:g}, not {wanted}"
        return Verdict(Fault.OTHER_POSITION, text, off)
    axes = _swapped(mean_g, expected, plan.tolerance_deg)
    if axes is not None:
        return Verdict(Fault.SIGN if "reversed" in axes else Fault.AXES, f"{axes} at {wanted}", off)
    alpha, beta = angles_of(plan, mean_g)
    text = f"this looks like alpha {alpha:.1f}, beta {beta:.1f}, not {wanted}"
    return Verdict(Fault.OTHER_POSITION, text, off)


def angles_of(plan: CapturePlan, mean_g: NDArray[np.float64]) -> tuple[float, float]:
    """The angles at which an ideal instrument has this direction, deg, alpha in [0, 360)."""
    force = mean_g if plan.mount is None else plan.mount.T @ mean_g
    force = force / np.linalg.norm(force)
    beta = -np.degrees(np.arcsin(np.clip(force[0], -1, 1)))
    return float(np.degrees(np.arctan2(force[1], force[2])) % 360), float(beta)


def _swapped(mean_g: NDArray[np.float64], expected: NDArray[np.float64], tolerance_deg: float) -> str | None:
    """Whether one reversed axis or two exchanged axes would make it fit."""
    changes = {f"the sign of axis {name} seems reversed": np.diag(1 - 2 * np.eye(3)[k]) for k, name in enumerate(AXES)}
    changes |= {"all signs seem reversed": -np.eye(3)}
    for first, second in combinations(range(3), 2):
        order = [{first: second, second: first}.get(k, k) for k in range(3)]
        changes[f"axes {AXES[first]} and {AXES[second]} seem exchanged"] = np.eye(3)[order]
    fitting = (
        words for words, change in changes.items() if angle_between_deg(change @ mean_g, expected) <= tolerance_deg
    )
    return next(fitting, None)


def _range_hint(size: float) -> str:
    for factor in (0.5, 2.0, 3.0, 6.0, 8.0, 1 / 3, 1 / 6, 1 / 8, 4.0, 0.25, 16.0):
        if abs(size / factor - 1) < 0.05:
            return f"in error by a factor {factor:.3g}"
    return "check range and unit"
