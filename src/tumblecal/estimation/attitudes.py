"""Attitudes for a hand-held triad, in words, and those that a hand-held set needs most.

At rest in an unknown attitude a position determines one number: the norm of the corrected reading, 1 g. Along the
direction u of a reading the norm changes with the sensor's parameters by u_x^2, u_y^2, u_z^2 (dK), u_x, u_y, u_z
(bias) and u_y u_x, u_z u_x, u_z u_y (gamma_21, _31, _32), to first order (Frosio, Pedersini and Borghese 2009). All
nine are errors in g at 1 g: the weakest direction is that of the largest eigenvalue of their covariance.
"""

from dataclasses import dataclass
from functools import cache
from itertools import combinations, product

import numpy as np
from jaxtyping import Float

from tumblecal.ground.axes import AXES


MOST, _MOST_WORDED = 6, 3
_TILT_DEG = 20.0
# An attitude that reduces the largest sd by less than this share is not proposed.
_LEAST = 0.03
# Prior sd of the parameters, in units of the sd of a position: gives sets that are too small a finite covariance.
_BEFORE_SD = 1e4
# Power of the norm over the sds: the largest dominates, but if two are equal, an improvement of either still counts.
_POWER = 4
# Attitudes equal by symmetry (to this share) are ties: the first is chosen, independent of rounding.
_TIE = 1e-6


@dataclass(frozen=True)
class Attitude:
    """An attitude of the triad: in `words`, and `up`, the upward unit vector in its axes, which is its ideal reading in g."""

    words: str
    up: Float[np.ndarray, "3"]


@cache
def attitudes() -> tuple[Attitude, ...]:
    """Faces, edges and corners down, and faces tilted towards another."""
    sides = {f"{sign}{axis}": (1 if sign == "+" else -1) * np.eye(3)[k] for k, axis in enumerate(AXES) for sign in "+-"}
    listed = [Attitude(f"place it on the {name} face", -down) for name, down in sides.items()]
    for (first, one), (second, other) in product(sides.items(), sides.items()):
        if one @ other == 0:
            angle = np.radians(_TILT_DEG)
            words = f"place it on the {first} face, tilted {_TILT_DEG:g} deg towards {second}"
            listed.append(Attitude(words, -(np.cos(angle) * one + np.sin(angle) * other)))
    for count, kind in ((2, "edge"), (3, "corner")):
        for chosen in combinations(sides.items(), count):
            down = np.sum([side for _, side in chosen], axis=0)
            if down @ down == count:
                *names, last = (name for name, _ in chosen)
                between = f"{', '.join(names)} and {last}"
                listed.append(Attitude(f"place it on the {kind} between {between}", -down / np.sqrt(count)))
    return tuple(listed)


def slopes(up: Float[np.ndarray, "positions 3"]) -> Float[np.ndarray, "positions 9"]:
    """Derivative of the norm of a reading by dK, bias and gamma, for unit vectors of gravity."""
    x, y, z = up.T
    return np.column_stack([up**2, up, y * x, z * x, z * y])


def next_attitudes(readings: Float[np.ndarray, "positions 3"], most: int = MOST) -> list[tuple[Attitude, float]]:
    """The attitudes that a hand-held set needs most.

    **Arguments:**

    - `readings`: of the set, g. `most`: largest number of attitudes.

    **Returns:** attitudes in order of benefit, each with the share by which it reduces the sd of the weakest direction, given
    the attitudes before it.
    """
    known = slopes(readings / np.linalg.norm(readings, axis=1, keepdims=True))
    covariance = np.linalg.inv(known.T @ known + np.eye(9) / _BEFORE_SD**2)
    chosen: list[tuple[Attitude, float]] = []
    rows = slopes(np.array([attitude.up for attitude in attitudes()]))
    for _ in range(most):
        after = [_with(covariance, row) for row in rows]
        undetermined = _worst(covariance, np.inf) > _BEFORE_SD / 2
        if undetermined:
            # While a direction is undetermined, its sd hides the others: use the determinant.
            score = -np.einsum("ri,ij,rj->r", rows, covariance, rows)
        else:
            score = np.array([_worst(candidate, _POWER) for candidate in after])
        best = int(np.argmax(score <= score.min() + _TIE * abs(score.min())))
        if not undetermined and _worst(after[best], _POWER) > (1 - _LEAST) * _worst(covariance, _POWER):
            break
        reduction = 1 - _worst(after[best], np.inf) / _worst(covariance, np.inf)
        chosen.append((attitudes()[best], float(reduction)))
        covariance = after[best]
    return chosen


def _with(covariance: Float[np.ndarray, "9 9"], row: Float[np.ndarray, "9"]) -> Float[np.ndarray, "9 9"]:
    """The covariance after one more position (Sherman and Morrison)."""
    gain = covariance @ row
    return covariance - np.outer(gain, gain) / (1 + row @ gain)


def _worst(covariance: Float[np.ndarray, "9 9"], power: float) -> float:
    """The largest sd of a direction; with a finite power a smooth maximum."""
    return float(np.sqrt(np.linalg.norm(np.linalg.eigvalsh(covariance), power)))


def attitude_words(readings: Float[np.ndarray, "positions 3"]) -> str:
    """The attitudes that a set (readings in g) needs most, in words; empty if none would help."""
    return "; ".join(attitude.words for attitude, _ in next_attitudes(readings, _MOST_WORDED))
