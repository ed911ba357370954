"""Common practice as positions of a head: the plans with which a designed plan is compared."""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.ground.frames import angle_between_deg, gravity_in_head, rotation_matrix
from tumblecal.plan.cells import Cells, Positions


# Positions of a random plan.
_RANDOM = 24


def common_plans(
    ability: HeadAbility, rotations_deg: Mapping[str, Sequence[float]], seed: int = 0
) -> tuple[Positions, ...]:
    """Plans of common practice, each once, at the nearest angles that the head can set.

    **Arguments:**

    - `rotations_deg`: intended rotation of each mounting about x, y, z; none: aligned with the head.
    - `seed`: of the random plan.
    """
    eighths, twelfths = np.arange(0, 360, 45.0), np.arange(0, 360, 30.0)
    golden = (1 + 5**0.5) / 2
    corners = [np.roll((0.0, sign, turn * golden), shift) for shift in range(3) for sign in (1, -1) for turn in (1, -1)]
    circles = [
        np.roll((np.cos(angle), np.sin(angle), 0.0), shift) for shift in range(3) for angle in np.radians(twelfths)
    ]
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    every = [
        (alpha, beta, mount) for mount, beta, alpha in product(ability.mounts, ability.beta_deg, ability.alpha_deg)
    ]
    random = np.sort(np.random.default_rng(seed).choice(len(every), min(_RANDOM, len(every)), replace=False))
    return (
        _of_angles("3 x 8", "Gao, Chen and Ren 2016", ability, eighths, (0.0, 45.0, 90.0)),
        _of_directions("six positions", "IEEE Std 1293", ability, rotations_deg, faces),
        _of_angles("4 x 12", "common grid", ability, twelfths, (0.0, 30.0, 60.0, 90.0)),
        _of_directions("icosahedron", "Ye and Su 2015", ability, rotations_deg, np.array(corners)),
        _of_directions("12-point tumble of each axis", "IEEE Std 1293", ability, rotations_deg, np.array(circles)),
        Positions("random", f"seed {seed}", Cells.listed([every[k] for k in random])),
    )


def _of_angles(
    name: str, source: str, ability: HeadAbility, alpha_deg: Sequence[float] | np.ndarray, beta_deg: Sequence[float]
) -> Positions:
    """A grid of angles in the first mounting."""
    wanted = [gravity_in_head(*np.radians((alpha, beta))) for beta, alpha in product(beta_deg, alpha_deg)]
    settable = [_settable(ability, direction) for direction in wanted]
    rows = dict.fromkeys((*angles, ability.mounts[0]) for angles, _ in settable)
    return Positions(name, source, Cells.listed(list(rows)), max(deviation for _, deviation in settable))


def _of_directions(
    name: str,
    source: str,
    ability: HeadAbility,
    rotations_deg: Mapping[str, Sequence[float]],
    wanted: Float[np.ndarray, "positions 3"],
) -> Positions:
    """Directions of gravity in the axes of the sensor, each in the first mounting in which the head comes nearest to it."""
    chosen, deviation = set[tuple[int, float, float]](), 0.0
    for direction in wanted / np.linalg.norm(wanted, axis=1, keepdims=True):
        nearest, found = 180.0, (0, 0.0, 0.0)
        for number, mount in enumerate(ability.mounts):
            rotation = rotation_matrix(np.radians(rotations_deg.get(mount, (0.0, 0.0, 0.0))))
            (alpha, beta), angle = _settable(ability, rotation.T @ direction)
            if angle < nearest - 0.1:
                nearest, found = angle, (number, beta, alpha)
        deviation = max(deviation, nearest)
        chosen.add(found)
    # One mounting and one pitch setting after the other.
    rows = [(alpha, beta, ability.mounts[number]) for number, beta, alpha in sorted(chosen)]
    return Positions(name, source, Cells.listed(rows), deviation)


def _settable(ability: HeadAbility, direction: Float[np.ndarray, "3"]) -> tuple[tuple[float, float], float]:
    """The angles, deg, that the head can set nearest to those of a direction of gravity, and the angle between both."""
    x, y, z = direction
    alpha, beta = np.degrees([np.arctan2(y, z), -np.arcsin(np.clip(x, -1, 1))])
    turn, tilt = np.array(ability.alpha_deg) - alpha, np.array(ability.beta_deg) - beta
    nearest = np.argmin(np.round(np.minimum(turn % 360.0, -turn % 360.0), 6)), np.argmin(np.round(np.abs(tilt), 6))
    angles = ability.alpha_deg[int(nearest[0])], ability.beta_deg[int(nearest[1])]
    return angles, angle_between_deg(gravity_in_head(*np.radians(angles)), direction)
