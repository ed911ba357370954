"""Common practice as positions of a head: the plans with which a designed plan is compared."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.ground.frames import gravity_in_head, rotation_matrix
from tumblecal.plan.cells import Numbers, Positions, cells_of


# Positions of a random plan.
_RANDOM = 24
# A cell is preferred to those before it if it comes nearer by this, deg.
_NEARER_DEG = 0.1
_GOLDEN, _TWELFTHS = (1 + 5**0.5) / 2, np.radians(np.arange(0, 360, 30.0))
# Directions of gravity in the axes of the sensor.
_FACES = np.concatenate([np.eye(3), -np.eye(3)])
_CORNERS = [np.roll((0.0, one, other * _GOLDEN), k) for k in range(3) for one in (1, -1) for other in (1, -1)]
_CIRCLES = [np.roll((np.cos(angle), np.sin(angle), 0.0), k) for k in range(3) for angle in _TWELFTHS]


def common_plans(
    ability: HeadAbility, rotations_deg: Mapping[str, Sequence[float]], seed: int = 0
) -> tuple[Positions, ...]:
    """Plans of common practice, each once, at the nearest angles that the head can set.

    **Arguments:**

    - `rotations_deg`: intended rotation of each mounting about x, y, z; none: aligned with the head.
    - `seed`: of the random plan.
    """
    cells = cells_of(replace(ability, temperatures_degc=()))
    turns = [rotation_matrix(np.radians(rotations_deg.get(mount, (0.0, 0.0, 0.0)))) for mount in ability.mounts]
    force = np.array(gravity_in_head(np.radians(cells.alpha_deg), np.radians(cells.beta_deg)))
    of_sensor = np.einsum("nij,nj->ni", np.array(turns)[cells.mounting], force)

    def nearest(
        name: str,
        source: str,
        wanted: Sequence[np.ndarray] | np.ndarray,
        more: float | Float[np.ndarray, "n cells"] = 0.0,
    ) -> Positions:
        """Directions of gravity in the axes of the sensor, each in the first mounting in which the head comes nearest to it;
        `more`: preferences among equal directions, in steps."""
        unit = np.array(wanted) / np.linalg.norm(wanted, axis=1, keepdims=True)
        away = np.degrees(np.arccos(np.clip(unit @ of_sensor.T, -1.0, 1.0)))
        taken = np.argmin(np.round(away / _NEARER_DEG) + more, axis=1)
        return plan(name, source, taken, float(np.max(away[np.arange(len(taken)), taken])))

    def grid(name: str, source: str, step_deg: float, beta_deg: Sequence[float]) -> Positions:
        """All spindle angles of a step at some pitch settings, in the first mounting."""
        alpha, beta = np.array(list(product(np.arange(0, 360, step_deg), beta_deg))).T
        wanted = np.array(gravity_in_head(np.radians(alpha), np.radians(beta))) @ turns[0].T
        turn = np.abs((cells.alpha_deg - alpha[:, None] + 180.0) % 360.0 - 180.0)
        return nearest(name, source, wanted, turn / 360 + 1e6 * cells.mounting)

    def plan(name: str, source: str, taken: Numbers, away_deg: float = 0.0) -> Positions:
        return Positions(name, source, cells.chosen(np.unique(taken)), round(away_deg, 6))

    random = np.random.default_rng(seed).choice(len(cells), min(_RANDOM, len(cells)), replace=False)
    return (
        grid("3 x 8", "Gao, Chen and Ren 2016", 45.0, (0.0, 45.0, 90.0)),
        nearest("six positions", "IEEE Std 1293", _FACES),
        grid("4 x 12", "common grid", 30.0, (0.0, 30.0, 60.0, 90.0)),
        nearest("icosahedron", "Ye and Su 2015", _CORNERS),
        nearest("12-point tumble of each axis", "IEEE Std 1293", _CIRCLES),
        plan("random", f"seed {seed}", random),
    )
