"""Common practice as positions of a head: the plans with which a designed plan is compared."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.ground.frames import gravity_in_head, rotation_matrix


# Positions of a random plan.
_RANDOM = 24


@dataclass(frozen=True)
class Positions:
    """Positions of a plan in measuring order: its name, its source, angles (deg) and labels of the mountings.

    `deviation_deg`: largest angle between the intended direction of gravity and the nearest one that the head can set.
    `temperature_degc`: of each position, if stated.
    """

    name: str
    source: str
    alpha_deg: tuple[float, ...]
    beta_deg: tuple[float, ...]
    mounts: tuple[str, ...]
    deviation_deg: float = 0.0
    temperature_degc: tuple[float, ...] | None = None

    def __len__(self) -> int:
        return len(self.alpha_deg)

    def at_each(self, temperatures_degc: Sequence[float]) -> "Positions":
        """All positions at each temperature, every second time in the reverse order: the mounting stays when it changes."""
        count = len(self)
        rows = [row for k in range(len(temperatures_degc)) for row in range(count)[:: -1 if k % 2 else 1]]
        return replace(
            self,
            alpha_deg=tuple(self.alpha_deg[row] for row in rows),
            beta_deg=tuple(self.beta_deg[row] for row in rows),
            mounts=tuple(self.mounts[row] for row in rows),
            temperature_degc=tuple(float(degc) for degc in temperatures_degc for _ in range(count)),
        )


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
    listed = [
        (alpha, beta, mount) for mount in ability.mounts for beta in ability.beta_deg for alpha in ability.alpha_deg
    ]
    random = np.sort(np.random.default_rng(seed).choice(len(listed), min(_RANDOM, len(listed)), replace=False))
    alpha, beta, mounts = zip(*(listed[k] for k in random), strict=True)
    return (
        _of_angles("3 x 8", "Gao, Chen and Ren 2016", ability, eighths, (0.0, 45.0, 90.0)),
        _of_directions("six positions", "IEEE Std 1293", ability, rotations_deg, faces),
        _of_angles("4 x 12", "common grid", ability, twelfths, (0.0, 30.0, 60.0, 90.0)),
        _of_directions("icosahedron", "Ye and Su 2015", ability, rotations_deg, np.array(corners)),
        _of_directions("12-point tumble of each axis", "IEEE Std 1293", ability, rotations_deg, np.array(circles)),
        Positions("random", f"seed {seed}", alpha, beta, mounts),
    )


def _of_angles(
    name: str, source: str, ability: HeadAbility, alpha_deg: Sequence[float] | np.ndarray, beta_deg: Sequence[float]
) -> Positions:
    """A grid of angles in the first mounting."""
    wanted = np.radians([(alpha, beta) for beta in beta_deg for alpha in alpha_deg])
    settable = [_settable(ability, *pair) for pair in np.degrees(wanted)]
    deviation = _largest_angle(gravity_in_head(*wanted.T), gravity_in_head(*np.radians(settable).T))
    once = list(dict.fromkeys(settable))
    alpha, beta = zip(*once, strict=True)
    return Positions(name, source, alpha, beta, ability.mounts[:1] * len(once), deviation)


def _of_directions(
    name: str,
    source: str,
    ability: HeadAbility,
    rotations_deg: Mapping[str, Sequence[float]],
    wanted: Float[np.ndarray, "positions 3"],
) -> Positions:
    """Directions of gravity in the axes of the sensor, each in the first mounting in which the head comes nearest to it."""
    wanted = wanted / np.linalg.norm(wanted, axis=1, keepdims=True)
    chosen, deviation = list[tuple[int, float, float]](), 0.0
    for direction in wanted:
        nearest = (180.0, 0, (0.0, 0.0))
        for number, mount in enumerate(ability.mounts):
            rotation = rotation_matrix(np.radians(rotations_deg.get(mount, (0.0, 0.0, 0.0))))
            x, y, z = rotation.T @ direction
            pair = _settable(ability, np.degrees(np.arctan2(y, z)), np.degrees(-np.arcsin(np.clip(x, -1, 1))))
            angle = _largest_angle(rotation.T @ direction, gravity_in_head(*np.radians(pair)))
            if angle < nearest[0] - 0.1:
                nearest = angle, number, pair
        deviation = max(deviation, nearest[0])
        _, number, (alpha_deg, beta_deg) = nearest
        chosen.append((number, beta_deg, alpha_deg))
    # One mounting and one pitch setting after the other.
    number, beta, alpha = zip(*sorted(dict.fromkeys(chosen)), strict=True)
    return Positions(name, source, alpha, beta, tuple(ability.mounts[k] for k in number), deviation)


def _settable(ability: HeadAbility, alpha_deg: float, beta_deg: float) -> tuple[float, float]:
    """The nearest angles that the head can set."""
    return (
        _nearest(ability.alpha_deg, alpha_deg, turn=360.0),
        _nearest(ability.beta_deg, beta_deg),
    )


def _nearest(settings: Sequence[float], wanted: float, *, turn: float = 0.0) -> float:
    distance = np.abs(np.array(settings) - wanted)
    if turn:
        distance = np.minimum(distance % turn, -distance % turn)
    return settings[int(np.argmin(np.round(distance, 6)))]


def _largest_angle(wanted: np.ndarray, attained: np.ndarray) -> float:
    cosine = np.sum(wanted * attained, axis=-1)
    return float(np.degrees(np.max(np.arccos(np.clip(cosine, -1.0, 1.0)))))
