"""The smallest changes that a recording detects with probability 0.8, and the changes that it cannot see."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.check.consistency import Consistency
from tumblecal.check.usual_changes import USUAL
from tumblecal.data.sensor_parameters import SENSOR, UNITS
from tumblecal.ground.record import rows
from tumblecal.ground.units import in_words, shown


POWER = 0.8
# A change of a parameter that is detected only above this many times the usual size is listed as invisible.
_MOST_TIMES = 30.0
_POOR_TIMES = 2.0
# Parameters with a smaller share of a combination (of the largest, in usual sizes) are not named.
_LEAST_SHARE = 0.15
# Between the parameters of a combination.
JOINED = ", "


@dataclass(frozen=True)
class Sensitivity:
    """Detection limits of a check.

    - `limits` (9): smallest detected change of each parameter alone, base units; infinite if it is invisible.
    - `worst` (9): the smallest detected change of the visible combination that is most difficult to detect. `hidden`: changes
      of several parameters together that cancel in all attitudes, each (9) as multiples of the usual sizes.
    """

    limits: Float[np.ndarray, "9"]
    worst: Float[np.ndarray, "9"]
    hidden: Float[np.ndarray, "combinations 9"]

    @property
    def invisible(self) -> tuple[str, ...]:
        """Parameters whose change alone is not visible."""
        return tuple(name for name, limit in zip(SENSOR, self.limits, strict=True) if np.isinf(limit))

    @property
    def limits_with_units(self) -> list[dict[str, Any]]:
        """The limits with their units."""
        return rows(value=self.limits, unit=[UNITS[name] for name in SENSOR])

    @property
    def poorly_visible(self) -> dict[str, float]:
        """Parameters whose detection limit is larger than two usual changes, with the limit."""
        listed = zip(SENSOR, self.limits.tolist(), USUAL.tolist(), strict=True)
        return {name: limit for name, limit, usual in listed if _POOR_TIMES * usual < limit < np.inf}

    @property
    def hidden_together(self) -> list[str]:
        """The invisible combinations of visible parameters, in words."""
        return [combination_words(row * USUAL) for row in self.hidden if np.sum(np.abs(row) > _LEAST_SHARE) > 1]


def sensitivity(test: Consistency) -> Sensitivity:
    """The detection limits of a test."""
    limits = np.array([test.detectable(change) for change in np.diag(USUAL)])
    limits = np.where(limits > _MOST_TIMES, np.inf, limits) * USUAL
    worst = np.zeros(9)
    if test.dof:
        scaled = test.slopes * USUAL
        _, sizes, right = np.linalg.svd(np.linalg.solve(np.linalg.cholesky(test.covariance), scaled))
        worst = right[len(sizes) - 1] * USUAL
        worst = worst * min(test.detectable(worst), 1e6)
    return Sensitivity(limits, worst, _simplest(test.hidden))


def _simplest(hidden: Float[np.ndarray, "9 count"]) -> Float[np.ndarray, "count 9"]:
    """A basis of invisible changes in which each has few parameters: reduced row echelon form with pivoting."""
    rows = hidden.T.copy()
    for done in range(len(rows)):
        rest = np.abs(rows[done:])
        row, column = np.unravel_index(int(np.argmax(rest)), rest.shape)
        rows[[done, done + row]] = rows[[done + row, done]]
        rows[done] /= rows[done, column]
        for other in range(len(rows)):
            if other != done:
                rows[other] -= rows[other, column] * rows[done]
    return rows / np.max(np.abs(rows), axis=1, keepdims=True) if len(rows) else np.zeros((0, 9))


def combination_words(change: Float[np.ndarray, "9"]) -> str:
    """A change of several parameters: `bias_x +1.5 mg, dK_x -1.5e-3`."""
    share = np.abs(change) / USUAL
    parts = [
        change_words(name, float(size))
        for name, size, part in zip(SENSOR, change, share, strict=True)
        if part > _LEAST_SHARE * share.max()
    ]
    return JOINED.join(parts)


def change_words(name: str, change: float) -> str:
    """A change of one parameter with its sign: `bias_x +1.5 mg`."""
    unit, factor = shown(UNITS[name])
    return f"{name} {in_words(f'{change * factor:+.2g}', unit)}"


def size_words(name: str, size: float) -> str:
    """A size of a change of one parameter: `1.5 mg`."""
    unit, factor = shown(UNITS[name])
    return in_words(f"{size * factor:.2g}", unit)
