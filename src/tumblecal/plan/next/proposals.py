"""Candidates for the next measurement: single positions of a grid, turns of the spindle with the triad remounted, the last run
in the reverse order, and positions that sample an unexplained error."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from tumblecal.data import PositionSet
from tumblecal.diagnosis import Diagnosis


STEP_DEG = 15
# Numbers of positions of a turn with the triad remounted.
TURNS = (4, 8)
# With the spindle nearly upright: cos beta below this.
_LEAST_LEVEL = 0.2
# Longer runs are not proposed again as a whole.
MOST_REVERSED = 100
# How the triad may be turned in its fixture: words, and the rotation Rx Ry Rz that takes the head's axes to its own.
SIDES = MappingProxyType({"turned 90 deg about y": (0.0, 90.0, 0.0), "turned 90 deg about z": (0.0, 0.0, 90.0)})
SAMPLE = "sample the unexplained error"
REVERSED = "Keep this order, the reverse of the first: an error that depends on time then appears at different angles."
# No position is proposed between measured angles with a larger distance (deg).
_FARTHEST_DEG = 120.0
_LEAST = 3


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
class NextPosition:
    """A proposal, its angles in degrees.

    `mount`: "" for the present mounting, otherwise the turn of the triad (a key of `SIDES`); `alpha_deg` is then the first of a
    turn, `turn_deg` all of it. `purpose` in words; `value`: the expected log Bayes factor that it adds, the share by which it
    reduces the largest uncertainty, or the unexplained error there in standard deviations of the noise. `direction`: for a
    hand-held set the orientation in words; the angles are equivalent.
    """

    alpha_deg: float
    beta_deg: float
    mount: str = ""
    purpose: str = ""
    value: float = 0.0
    turn_deg: tuple[float, ...] = ()
    direction: str = ""

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """All its spindle angles."""
        return self.turn_deg or (self.alpha_deg,)

    @property
    def needs_others(self) -> bool:
        """Whether its new mounting must be measured at another pitch setting too: with the spindle upright (beta 90) the
        positions do not determine the angles of the mounting."""
        return bool(self.mount) and abs(np.cos(np.radians(self.beta_deg))) < _LEAST_LEVEL

    @property
    def each(self) -> list["NextPosition"]:
        """Its positions, one by one."""
        return [replace(self, alpha_deg=alpha, turn_deg=self.turn_deg and (alpha,)) for alpha in self.angles_deg]


def proposals(data: PositionSet, allowed: Allowed, sides: Sequence[str]) -> list[NextPosition]:
    """Everything that may be proposed.

    **Arguments:**

    - `data`: the present positions; by default proposals stay within their pitch angles.
    - `sides`: remountings that can be analysed. They are proposed at measured pitch settings if there are any.
    """
    beta = data.pitch_setting_deg
    alphas = allowed.alpha_deg or tuple(float(angle) for angle in range(0, 360, STEP_DEG))
    between = np.arange(np.ceil(beta.min() / STEP_DEG), np.floor(beta.max() / STEP_DEG) + 1) * STEP_DEG
    levels = {round(angle, 6): angle for angle in (*between.tolist(), *beta.tolist())}
    betas = [levels.get(round(angle, 6), angle) for angle in allowed.beta_deg or sorted(levels)]
    listed = [NextPosition(alpha, angle) for angle in betas for alpha in alphas]
    # A turn has so many of the spindle angles, spread over them.
    ordered, turns = sorted({*alphas}), dict[tuple[float, ...], None]()
    for count in np.minimum(TURNS, len(ordered)).tolist():
        turns[tuple(ordered[k * len(ordered) // count] for k in range(count))] = None
    known = [angle for angle in betas if angle in beta] or betas
    turned = [(side, angle, turn) for side in sides for angle in known for turn in turns]
    return listed + [NextPosition(turn[0], angle, side, turn_deg=turn) for side, angle, turn in turned]


def reversed_run(data: PositionSet, allowed: Allowed) -> list[NextPosition]:
    """All positions of the last run and mounting again, the last one first; none if they are many or may not be set again."""
    groups = list(zip(data.labels("run"), data.labels("mount"), strict=True))
    rows = [k for k in reversed(range(len(data))) if groups[k] == groups[-1]]
    usable = [
        given is None or np.all(np.any(np.isclose(given, angle[rows][:, None]), axis=1))
        for given, angle in ((allowed.alpha_deg, data.alpha_deg), (allowed.beta_deg, data.pitch_setting_deg))
    ]
    if not all(usable) or len(rows) > MOST_REVERSED:
        return []
    return [NextPosition(float(data.alpha_deg[k]), float(data.pitch_setting_deg[k])) for k in rows]


def by_pitch(chosen: Iterable[NextPosition]) -> list[NextPosition]:
    """Proposals in the order in which they are measured: those of one mounting, and of one pitch setting, together."""
    groups: dict[tuple[str, float], list[NextPosition]] = {}
    for proposal in chosen:
        groups.setdefault((proposal.mount, proposal.beta_deg), []).append(proposal)
    order = ("", *SIDES)
    return [proposal for key in sorted(groups, key=lambda key: order.index(key[0])) for proposal in groups[key]]


def samples(diagnosis: Diagnosis, allowed: Allowed, most: int) -> list[NextPosition]:
    """Positions where an unexplained error is: between neighbouring spindle angles of a pitch setting, or at the allowed ones,
    and if these are few also at the measured ones; the last measured first. Their value is the error near them in standard
    deviations of the noise."""
    unnamed, data = diagnosis.unnamed, diagnosis.data
    assert unnamed is not None
    sizes = np.max(np.abs(unnamed.excess.values) / (diagnosis.level * diagnosis.problem.sd), axis=1)
    # Angles, and the measured positions near them.
    listed = list[tuple[float, float, list[int]]]()
    for level in np.unique(data.pitch_setting_deg).tolist():
        here = np.flatnonzero((data.pitch_setting_deg == level) & unnamed.fit.retained)
        if not len(here) or not (allowed.beta_deg is None or np.any(np.isclose(allowed.beta_deg, level))):
            continue
        here = here[np.argsort(np.mod(data.alpha_deg[here], 360.0), kind="stable")]
        alpha = np.mod(data.alpha_deg[here], 360.0)
        gaps = np.mod(np.roll(alpha, -1) - alpha, 360.0)
        between = np.mod(alpha + 0.5 * gaps, 360.0)[(gaps > 0) & (gaps <= _FARTHEST_DEG)]
        for angle in between.tolist() if allowed.alpha_deg is None else allowed.alpha_deg:
            before = int(np.argmin(np.mod(angle - alpha, 360.0)))
            listed.append((float(angle), level, [int(here[before]), int(here[(before + 1) % len(here)])]))

    def shown(near: list[int]) -> bool:
        return bool(np.any(unnamed.excess.positions[near]))

    if sum(shown(near) for *_, near in listed) < _LEAST and allowed.alpha_deg is None and allowed.beta_deg is None:
        listed += zip(
            data.alpha_deg.tolist(), data.pitch_setting_deg.tolist(), ([k] for k in range(len(data))), strict=True
        )
    chosen = sorted((one for one in listed if shown(one[2])), key=lambda one: -np.mean(sizes[one[2]]))[:most]
    order = diagnosis.problem.where.measuring_order
    chosen.sort(key=lambda one: -np.mean(order[one[2]]))
    return [NextPosition(alpha, beta, "", SAMPLE, float(np.mean(sizes[near]))) for alpha, beta, near in chosen]
