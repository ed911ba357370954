"""Axes with the wrong sign, or exchanged, in a part of the rows: a pitch setting, a run, from some row on."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.estimation.angle_hypotheses import SAME, AngleSearch
from tumblecal.estimation.angle_misfit import EQUAL, misfit
from tumblecal.ground.axes import AXES


class PartMap(NamedTuple):
    """The axes of the columns in some rows: `matrix` takes readings on the plan's axes to those in the file."""

    words: str
    rows: Bool[np.ndarray, " positions"]
    matrix: Float[np.ndarray, "3 3"]

    def corrected(self, readings: Float[np.ndarray, "positions 3"]) -> Float[np.ndarray, "positions 3"]:
        """The readings (g) with those of its rows on the plan's axes."""
        return np.where(self.rows[:, None], readings @ self.matrix, readings)


def part_maps(search: AngleSearch, ideal: Float[np.ndarray, "positions 3"]) -> tuple[list[PartMap], float]:
    """The maps of a part that fit best, and their misfit; among maps with the same effect, the one with the smallest residuals.

    **Arguments:**

    - `ideal`: readings of a perfect instrument at all positions of the set, g.
    """
    maps = [PartMap(f"{words}{part}", rows, matrix) for part, rows in search.stretches() for words, matrix in _maps()]
    if not maps:
        return [], np.inf
    mounting = search.rows
    mapped = np.stack(
        [np.where(part.rows[mounting, None], ideal[mounting] @ part.matrix.T, ideal[mounting]) for part in maps]
    )
    cost, _ = misfit(mapped, search.data.readings[mounting])
    order = np.argsort(cost, kind="stable")
    best = [k for k in order.tolist() if cost[k] < cost[order[0]] + EQUAL]
    # A bias also shows at zero input, so the map with the smallest residuals comes first.
    best.sort(key=lambda k: search.ss_with_pitch_errors(search.as_written(), maps[k].corrected(search.data.readings)))
    distinct: list[int] = []
    for k in best:
        if all(np.max(np.abs(mapped[k] - mapped[other])) > SAME for other in distinct):
            distinct.append(k)
    return [maps[k] for k in distinct], float(cost[order[0]])


def _maps() -> Iterator[tuple[str, Float[np.ndarray, "3 3"]]]:
    for axis, name in enumerate(AXES):
        yield f"column {name} has the wrong sign", np.diag([-1.0 if axis == k else 1.0 for k in range(3)])
    yield "all columns have the wrong sign", -np.eye(3)
    for first, second in ((0, 1), (0, 2), (1, 2)):
        order = [second if k == first else first if k == second else k for k in range(3)]
        yield f"columns {AXES[first]} and {AXES[second]} are exchanged", np.eye(3)[order]
    for step in (1, 2):
        order = [(k + step) % 3 for k in range(3)]
        yield f"columns x, y, z contain {', '.join(AXES[k] for k in order)}", np.eye(3)[order]
