"""Proposals chosen by their value: the best single ones, and a set with a large joint value."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.planning.new_rows import Rows
from tumblecal.planning.posterior import Value
from tumblecal.planning.proposals import Proposal


MOST_IN_SET = 12
# A position with new unknown parameters counts for so many: a new pitch setting or mounting is more work.
_EFFORT = 2.0


@dataclass(frozen=True)
class Choosing:
    """Proposals to choose from: `listed`, with their `rows`."""

    listed: list[Proposal]
    rows: Rows

    @cached_property
    def _alone(self) -> Bool[np.ndarray, " listed"]:
        """Which proposals can be analysed alone: positions of a new mounting must determine its angles."""
        pairs = zip(self.listed, self.rows.cells, strict=True)
        return np.array([not one.side or self.rows.determine_group_parameters(cells) for one, cells in pairs], bool)

    def best(self, value: Value, most: int, least: float) -> list[tuple[Proposal, float]]:
        """The best single proposals with their values: at most `most`, each with a value above `least`."""
        values = np.where(self._alone, value.of(self.rows.cells), 0.0)
        order = np.argsort(-values, kind="stable")[:most].tolist()
        return [(self.listed[k], float(values[k])) for k in order if values[k] > least]

    def greedy(self, value: Value, least: Float[np.ndarray, " listed"]) -> list[tuple[Proposal, float]]:
        """A set chosen one by one, each the best per position given those before it, with the value that each adds.

        **Arguments:**

        - `least`: the value of each proposal below which it is not added.
        """
        chosen: list[tuple[Proposal, float]] = []
        cost = np.array([one.cost for one in self.listed])
        new = [bool(self.rows.of_new_groups(cells).size) for cells in self.rows.cells]
        spent, sides = set[tuple[str, float, float]](), set[str]()
        while value.lacking > 0.0:
            # The same position is not proposed twice: a turn of four is part of that of eight.
            usable = [
                (alone or one.side in sides) and one.cost <= MOST_IN_SET - len(spent) and not spent & one.places
                for one, alone in zip(self.listed, self._alone, strict=True)
            ]
            values = value.of(self.rows.cells)
            usable &= values >= least
            if not np.any(usable):
                break
            worth = np.minimum(values, value.lacking) / cost / np.where(new, _EFFORT, 1.0)
            best = int(np.argmax(np.where(usable, worth, 0.0)))
            chosen.append((self.listed[best], value.take(self.rows.cells[best])))
            spent |= self.listed[best].places
            sides.add(self.listed[best].side)
        return chosen
