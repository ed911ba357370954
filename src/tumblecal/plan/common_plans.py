"""Common practice as positions of a head: the plans with which a designed plan is compared."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
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
    golden = (1 + 5**0.5) / 2
    corners = [np.roll((0.0, sign, turn * golden), shift) for shift in range(3) for sign in (1, -1) for turn in (1, -1)]
    twelfths = np.radians(np.arange(0, 360, 30.0))
    circles = [np.roll((np.cos(angle), np.sin(angle), 0.0), shift) for shift in range(3) for angle in twelfths]
    every = [
        (alpha, beta, mount) for mount, beta, alpha in product(ability.mounts, ability.beta_deg, ability.alpha_deg)
    ]
    random = np.sort(np.random.default_rng(seed).choice(len(every), min(_RANDOM, len(every)), replace=False))
    # Grids of angles in the first mounting; directions of gravity in the axes of the sensor.
    first, whole = (
        partial(_plan, replace(ability, mounts=ability.mounts[:1]), {}),
        partial(_plan, ability, rotations_deg),
    )
    return (
        first("3 x 8", "Gao, Chen and Ren 2016", _grid(45.0, (0.0, 45.0, 90.0))),
        whole("six positions", "IEEE Std 1293", np.concatenate([np.eye(3), -np.eye(3)])),
        first("4 x 12", "common grid", _grid(30.0, (0.0, 30.0, 60.0, 90.0))),
        whole("icosahedron", "Ye and Su 2015", np.array(corners)),
        whole("12-point tumble of each axis", "IEEE Std 1293", np.array(circles)),
        Positions("random", f"seed {seed}", Cells.listed([every[k] for k in random])),
    )


def _grid(step_deg: float, beta_deg: Sequence[float]) -> Float[np.ndarray, "positions 3"]:
    """Directions of gravity at all spindle angles of a step, at some pitch settings."""
    return np.array([gravity_in_head(*np.radians((a, b))) for b in beta_deg for a in np.arange(0, 360, step_deg)])


def _plan(
    ability: HeadAbility,
    rotations_deg: Mapping[str, Sequence[float]],
    name: str,
    source: str,
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
    return Positions(name, source, Cells.listed(rows), round(deviation, 6))


def _settable(ability: HeadAbility, direction: Float[np.ndarray, "3"]) -> tuple[tuple[float, float], float]:
    """The angles, deg, that the head can set nearest to those of a direction of gravity, and the angle between both."""
    x, y, z = direction
    alpha, beta = np.degrees([np.arctan2(y, z), -np.arcsin(np.clip(x, -1, 1))])
    turn, tilt = np.array(ability.alpha_deg) - alpha, np.array(ability.beta_deg) - beta
    nearest = np.argmin(np.round(np.minimum(turn % 360.0, -turn % 360.0), 6)), np.argmin(np.round(np.abs(tilt), 6))
    angles = ability.alpha_deg[int(nearest[0])], ability.beta_deg[int(nearest[1])]
    return angles, angle_between_deg(gravity_in_head(*np.radians(angles)), direction)
