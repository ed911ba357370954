"""Proposals chosen by their value: the best single ones, and a set with a large joint value."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from tumblecal.planning.new_rows import Rows
from tumblecal.planning.proposals import Proposal
from tumblecal.planning.value import Separation, Sharpening


MOST_IN_SET = 12
# A position with new unknown parameters counts for so many: a new pitch setting or mounting is more work.
_EFFORT = 2.0


@dataclass(frozen=True)
class Choosing:
    """Proposals to choose from: `listed`, with their `rows`."""

    listed: list[Proposal]
    rows: Rows

    def best(self, value: Separation | Sharpening, most: int, least: float) -> list[tuple[int, float]]:
        """Numbers and values of the best single proposals: at most `most`, each with a value above `least`."""
        values = np.where(self._analysable([]), value.of(self.rows.cells), 0.0)
        order = np.argsort(-values, kind="stable")[:most].tolist()
        return [(k, float(values[k])) for k in order if values[k] > least]

    def greedy(self, value: Separation | Sharpening, least: Callable[[int], float]) -> list[tuple[int, float]]:
        """A set chosen one by one, each the best per position given those before it, with the value that each adds.

        **Arguments:**

        - `least`: the value below which nothing is added, for a number of positions of the proposal.
        """
        chosen: list[tuple[int, float]] = []
        effort = np.array([_EFFORT if np.any(self.rows.of_new_groups(cells)) else 1.0 for cells in self.rows.cells])
        spent = set[tuple[str, float, float]]()
        while not value.enough:
            usable = self._analysable([k for k, _ in chosen])
            # The same position is not proposed twice: a turn of four is part of that of eight.
            fits = [
                k
                for k, one in enumerate(self.listed)
                if usable[k] and one.cost <= MOST_IN_SET - len(spent) and not spent & one.places
            ]
            cells = [self.rows.cells[k] for k in fits]
            values = value.of(cells)
            enough = values >= [least(len(each)) for each in cells]
            if not np.any(enough):
                break
            best = int(np.argmax(np.where(enough, value.per_position(cells, values) / effort[fits], 0.0)))
            chosen.append((fits[best], float(values[best])))
            value.take(cells[best])
            spent |= self.listed[fits[best]].places
        return chosen

    def _analysable(self, chosen: list[int]) -> Bool[np.ndarray, " listed"]:
        """Which proposals can be analysed together with those chosen: positions of a new mounting must determine its angles."""
        of_mounting: dict[str, list[np.ndarray]] = {}
        for k in chosen:
            of_mounting.setdefault(self.listed[k].side, []).append(self.rows.cells[k])
        return np.array(
            [
                not proposal.side
                or self.rows.determine_group_parameters(np.concatenate([*of_mounting.get(proposal.side, ()), cells]))
                for proposal, cells in zip(self.listed, self.rows.cells, strict=True)
            ],
            bool,
        )
