"""The 24 quarter turns of a triad in its fixture, and distances of readings from those of a perfect triad at each turn."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.data import PositionSet
from tumblecal.ground.frames import gravity_in_head, rotation_matrix


# With fewer positions than this, one faulty position could decide.
FEWEST = 4
# Distances are limited to this (g), so that a reading in another unit does not decide.
_FARTHEST = 2.0

Angles: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class QuarterTurn:
    """One of the turns: its matrix, and `angles_deg` about x, y, z as in a rig's rotation_deg."""

    matrix: Float[np.ndarray, "3 3"]
    angles_deg: Angles


@cache
def quarter_turns() -> tuple[QuarterTurn, ...]:
    """The 24 proper quarter turns, the simplest angles of each; no turn first."""
    listed = sorted(
        product((0.0, 90.0, -90.0, 180.0), repeat=3),
        key=lambda angles: (sum(angle != 0 for angle in angles), sum(map(abs, angles))),
    )
    found: dict[bytes, QuarterTurn] = {}
    for x, y, z in listed:
        matrix = np.round(rotation_matrix(np.radians(np.array([x, y, z])))) + 0.0
        found.setdefault(matrix.tobytes(), QuarterTurn(matrix, (x, y, z)))
    return tuple(found.values())


def turn_of(matrix: Float[np.ndarray, "3 3"]) -> Angles | None:
    """The angles of a quarter turn (deg about x, y, z); None for any other rotation."""
    return next((turn.angles_deg for turn in quarter_turns() if np.max(np.abs(turn.matrix - matrix)) < 1e-9), None)


def turn_words(angles_deg: Sequence[float]) -> str:
    """A turn in words, such as `90 deg about z`; several angles as in a rig file."""
    about = [(angle, axis) for angle, axis in zip(angles_deg, "xyz", strict=True) if angle]
    if len(about) == 1:
        return f"{about[0][0]:g} deg about {about[0][1]}"
    return f"by rotation_deg = [{', '.join(f'{angle:g}' for angle in angles_deg)}]"


def distances(data: PositionSet, rows: Bool[np.ndarray, " positions"]) -> Float[np.ndarray, "2 24"]:
    """Mean distance (g) of some readings from those of a perfect triad at each turn, and at each turn with all axes mirrored;
    zero for fewer than `FEWEST` rows."""
    if rows.sum() < FEWEST:
        return np.zeros((2, len(quarter_turns())))
    size = float(np.median(np.linalg.norm(data.readings[rows], axis=1)))
    matrices = np.stack([turn.matrix for turn in quarter_turns()])
    ideal = np.einsum("tij,nj->tni", matrices, gravity_in_head(data.alpha[rows], data.beta[rows]))
    readings = data.readings[rows] / max(size, 1e-12)
    away = np.stack([np.linalg.norm(readings - sign * ideal, axis=2) for sign in (1.0, -1.0)])
    return np.minimum(away, _FARTHEST).mean(axis=2)
