"""Proposals chosen by their value: the best single ones, and a set with a large joint value."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tumblecal.planning.posterior import Value
from tumblecal.planning.proposals import NextPosition


MOST_IN_SET = 12
# A position with new unknown parameters counts for so many: a new pitch setting or mounting is more work.
_EFFORT = 2.0


def best_of(
    listed: Sequence[NextPosition], cells: Sequence[np.ndarray], value: Value, most: int, least: float
) -> list[NextPosition]:
    """The best single proposals with their values: at most `most`, each with a value above `least`; `cells`: of each."""
    values = np.where([one.needs_others for one in listed], 0.0, value.of(cells))
    order = np.argsort(-values, kind="stable")[:most].tolist()
    return [replace(listed[k], value=float(values[k])) for k in order if values[k] > least]


def greedy(
    listed: Sequence[NextPosition],
    cells: Sequence[np.ndarray],
    value: Value,
    least: Float[np.ndarray, " listed"],
    settings: Collection[float],
) -> list[NextPosition]:
    """A set chosen one by one, each the best per position given those before it, with the value that each adds.

    **Arguments:**

    - `least`: the value of each proposal below which it is not added. `settings`: measured pitch settings, deg.
    """
    chosen, spent = list[NextPosition](), set[tuple[str, float, float]]()
    places = [{(one.mount, one.beta_deg, alpha) for alpha in one.angles_deg} for one in listed]
    effort = [_EFFORT if one.mount or one.beta_deg not in settings else 1.0 for one in listed]
    while value.lacking > 0.0:
        values = value.of(cells)
        # The same position is not proposed twice: a turn of four is part of that of eight.
        fits = [len(own) <= MOST_IN_SET - len(spent) and not spent & own for own in places]
        mounts = {mount for mount, _, _ in spent}
        usable = fits & (values >= least) & [not one.needs_others or one.mount in mounts for one in listed]
        if not np.any(usable):
            break
        worth = np.minimum(values, value.lacking) / [len(own) for own in places] / effort
        best = int(np.argmax(np.where(usable, worth, 0.0)))
        chosen.append(replace(listed[best], value=value.take(cells[best])))
        spent |= places[best]
    return chosen
