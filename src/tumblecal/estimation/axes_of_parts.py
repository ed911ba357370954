"""Axes of another sign, or in each other's column, in a part of the rows: a pitch setting, a run, from some row on."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.estimation.angle_hypotheses import SAME, AngleSearch
from tumblecal.estimation.angle_misfit import ALIKE, misfit
from tumblecal.ground.axes import AXES


class PartMap(NamedTuple):
    """What the columns of some rows are: `matrix` takes readings on the plan's axes to those in the file."""

    words: str
    rows: Bool[np.ndarray, " positions"]
    matrix: Float[np.ndarray, "3 3"]

    def corrected(self, readings: Float[np.ndarray, "positions 3"]) -> Float[np.ndarray, "positions 3"]:
        """The readings, those of its rows on the plan's axes."""
        return np.where(self.rows[:, None], readings @ self.matrix, readings)


def part_maps(search: AngleSearch, ideal: Float[np.ndarray, "positions 3"]) -> tuple[list[PartMap], float]:
    """The maps of a part that fit best and their misfit; of those that move the same rows alike, the one that leaves least.

    **Arguments:**

    - `ideal`: what a perfect instrument reads at all positions of the set, g.
    """
    told = [PartMap(f"{words}{part}", rows, matrix) for part, rows in search.stretches() for words, matrix in _maps()]
    if not told:
        return [], np.inf
    own = search.rows
    mapped = np.stack([np.where(part.rows[own, None], ideal[own] @ part.matrix.T, ideal[own]) for part in told])
    cost, _ = misfit(mapped, search.data.readings[own])
    order = np.argsort(cost, kind="stable")
    best = [k for k in order.tolist() if cost[k] < cost[order[0]] + ALIKE]
    # What a bias does shows as well where an input is zero: of all that fit, what leaves least is first.
    best.sort(key=lambda k: search.left_by_pitch_errors(search.as_written(), told[k].corrected(search.data.readings)))
    apart: list[int] = []
    for k in best:
        if all(np.max(np.abs(mapped[k] - mapped[other])) > SAME for other in apart):
            apart.append(k)
    return [told[k] for k in apart], float(cost[order[0]])


def _maps() -> Iterator[tuple[str, Float[np.ndarray, "3 3"]]]:
    for axis, name in enumerate(AXES):
        yield f"column {name} has the other sign", np.diag([-1.0 if axis == k else 1.0 for k in range(3)])
    yield "all columns have the other sign", -np.eye(3)
    for first, second in ((0, 1), (0, 2), (1, 2)):
        order = [second if k == first else first if k == second else k for k in range(3)]
        yield f"columns {AXES[first]} and {AXES[second]} stand in each other's place", np.eye(3)[order]
    for step in (1, 2):
        order = [(k + step) % 3 for k in range(3)]
        yield f"columns x, y, z hold {', '.join(AXES[k] for k in order)}", np.eye(3)[order]
