"""Candidates for the next measurement: single positions of a grid, and turns of the spindle with the triad remounted."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from tumblecal.data import PositionSet


STEP_DEG = 15
# Numbers of positions of a turn with the triad remounted.
TURNS = (4, 8)
# Longer runs are not proposed again as a whole.
MOST_REVERSED = 100
# How the triad may be turned in its fixture: words, and the rotation Rx Ry Rz that takes the head's axes to its own.
SIDES = MappingProxyType({"turned 90 deg about y": (0.0, 90.0, 0.0), "turned 90 deg about z": (0.0, 0.0, 90.0)})


@dataclass(frozen=True)
class Allowed:
    """Angles and mountings that the laboratory can set.

    `alpha_deg`, `beta_deg`: the angles that may be used; None: every 15 degrees (pitch: within the range of the data, and
    the settings of the data).
    `remount`: whether the triad can be turned in its fixture.

    Examples:
        >>> from tumblecal.planning import Allowed
        >>> Allowed(alpha_deg=(0.0, 90.0, 180.0, 270.0), remount=False).beta_deg is None  # the range of the data
        True
    """

    alpha_deg: tuple[float, ...] | None = None
    beta_deg: tuple[float, ...] | None = None
    remount: bool = True


@dataclass(frozen=True)
class Proposal:
    """One proposal: `alpha_deg` all at one pitch setting; `side`: "" for the present mounting, otherwise a key of `SIDES`."""

    alpha_deg: tuple[float, ...]
    beta_deg: float
    side: str

    @property
    def cost(self) -> int:
        """Number of positions."""
        return len(self.alpha_deg)

    @property
    def places(self) -> set[tuple[str, float, float]]:
        """Its positions: side, beta and alpha, deg."""
        return {(self.side, self.beta_deg, alpha) for alpha in self.alpha_deg}


def proposals(data: PositionSet, allowed: Allowed, sides: Sequence[str]) -> list[Proposal]:
    """Everything that may be proposed.

    **Arguments:**

    - `data`: the present positions; by default proposals stay within their pitch angles.
    - `sides`: remountings that can be analysed.
    """
    beta = data.pitch_setting_deg
    alphas = allowed.alpha_deg or tuple(float(angle) for angle in range(0, 360, STEP_DEG))
    between = np.arange(np.ceil(beta.min() / STEP_DEG), np.floor(beta.max() / STEP_DEG) + 1) * STEP_DEG
    levels = {round(angle, 6): angle for angle in (*between.tolist(), *beta.tolist())}
    betas = allowed.beta_deg or tuple(levels[key] for key in sorted(levels))
    listed = [Proposal((alpha,), beta, "") for beta in betas for alpha in alphas]
    measured = [level for level in betas if np.any(np.isclose(beta, level))] or betas
    # A turn has so many of the spindle angles, spread over them.
    ordered, turns = sorted({*alphas}), dict[tuple[float, ...], None]()
    for count in np.minimum(TURNS, len(ordered)).tolist():
        turns[tuple(ordered[k * len(ordered) // count] for k in range(count))] = None
    return listed + [Proposal(turn, beta, side) for side in sides for beta in measured for turn in turns]


def reversed_run(data: PositionSet, allowed: Allowed) -> list[Proposal]:
    """All positions of the last run and mounting again, the last one first; none if they are many or may not be set again."""
    groups = list(zip(data.run or ("1",) * len(data), data.mount or ("1",) * len(data), strict=True))
    rows = [k for k in reversed(range(len(data))) if groups[k] == groups[-1]]
    usable = [
        given is None or np.all(np.any(np.isclose(given, angle[rows][:, None]), axis=1))
        for given, angle in ((allowed.alpha_deg, data.alpha_deg), (allowed.beta_deg, data.pitch_setting_deg))
    ]
    if not all(usable) or len(rows) > MOST_REVERSED:
        return []
    return [Proposal((float(data.alpha_deg[k]),), float(data.pitch_setting_deg[k]), "") for k in rows]


def by_pitch(chosen: Iterable[Proposal]) -> list[Proposal]:
    """Proposals in the order in which they are measured: those of one mounting, and of one pitch setting, together."""
    groups: dict[tuple[str, float], list[Proposal]] = {}
    for proposal in chosen:
        groups.setdefault((proposal.side, proposal.beta_deg), []).append(proposal)
    order = ("", *SIDES)
    return [proposal for key in sorted(groups, key=lambda key: order.index(key[0])) for proposal in groups[key]]
