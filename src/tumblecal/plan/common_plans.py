"""Common practice as positions of a head: the plans with which a designed plan is compared."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.ground.frames import gravity_in_head, rotation_matrix
from tumblecal.plan.cells import Positions, cells_of


# Positions of a random plan.
_RANDOM = 24
# A mounting is preferred to those before it if it comes nearer by this, deg.
_NEARER_DEG = 0.1


def common_plans(
    ability: HeadAbility, rotations_deg: Mapping[str, Sequence[float]], seed: int = 0
) -> tuple[Positions, ...]:
    """Plans of common practice, each once, at the nearest angles that the head can set.

    **Arguments:**

    - `rotations_deg`: intended rotation of each mounting about x, y, z; none: aligned with the head.
    - `seed`: of the random plan.
    """
    cells = cells_of(replace(ability, temperatures_degc=()))
    force = np.array(gravity_in_head(np.radians(cells.alpha_deg), np.radians(cells.beta_deg)))
    turns = [rotation_matrix(np.radians(rotations_deg.get(mount, (0.0, 0.0, 0.0)))) for mount in ability.mounts]
    of_sensor = np.einsum("nij,nj->ni", np.array(turns)[cells.mounting], force)

    def plan(name: str, source: str, taken: Int[np.ndarray, " taken"], away: Float[np.ndarray, " taken"]) -> Positions:
        return Positions(name, source, cells.chosen(np.unique(taken)), round(float(np.max(away)), 6))

    def directions(name: str, source: str, wanted: Float[np.ndarray, "taken 3"]) -> Positions:
        """Directions of gravity in the axes of the sensor, each in the first mounting in which the head comes nearest to it."""
        unit = wanted / np.linalg.norm(wanted, axis=1, keepdims=True)
        away = np.degrees(np.arccos(np.clip(unit @ of_sensor.T, -1.0, 1.0)))
        taken = np.argmin(np.round(away / _NEARER_DEG), axis=1)
        return plan(name, source, taken, away[np.arange(len(taken)), taken])

    def grid(name: str, source: str, step_deg: float, beta_deg: Sequence[float]) -> Positions:
        """All spindle angles of a step at some pitch settings, in the first mounting."""
        alpha, beta = np.array(list(product(np.arange(0, 360, step_deg), beta_deg))).T
        tilt = np.abs(cells.beta_deg - beta[:, None])
        turn = np.abs((cells.alpha_deg - alpha[:, None] + 180.0) % 360.0 - 180.0)
        taken = np.argmin(np.round(1e6 * cells.mounting + 1e3 * tilt + turn, 6), axis=1)
        wanted = np.array(gravity_in_head(np.radians(alpha), np.radians(beta)))
        return plan(name, source, taken, np.degrees(np.arccos(np.clip(np.vecdot(wanted, force[taken]), -1.0, 1.0))))

    golden = (1 + 5**0.5) / 2
    corners = [np.roll((0.0, sign, turn * golden), shift) for shift in range(3) for sign in (1, -1) for turn in (1, -1)]
    twelfths = np.radians(np.arange(0, 360, 30.0))
    circles = [np.roll((np.cos(angle), np.sin(angle), 0.0), shift) for shift in range(3) for angle in twelfths]
    random = np.random.default_rng(seed).choice(len(cells), min(_RANDOM, len(cells)), replace=False)
    return (
        grid("3 x 8", "Gao, Chen and Ren 2016", 45.0, (0.0, 45.0, 90.0)),
        directions("six positions", "IEEE Std 1293", np.concatenate([np.eye(3), -np.eye(3)])),
        grid("4 x 12", "common grid", 30.0, (0.0, 30.0, 60.0, 90.0)),
        directions("icosahedron", "Ye and Su 2015", np.array(corners)),
        directions("12-point tumble of each axis", "IEEE Std 1293", np.array(circles)),
        plan("random", f"seed {seed}", random, np.zeros(1)),
    )
