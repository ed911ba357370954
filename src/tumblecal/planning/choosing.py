"""Proposals chosen by their value: the best single ones, and a set with a large joint value."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from tumblecal.planning.new_rows import Rows
from tumblecal.planning.proposals import Proposal
from tumblecal.planning.value import Value


MOST_IN_SET = 12


@dataclass(frozen=True)
class Choosing:
    """Proposals to choose from: `listed`, with their `rows`."""

    listed: list[Proposal]
    rows: Rows

    def best(self, value: Value, most: int, least: float) -> list[tuple[int, float]]:
        """Numbers and values of the best single proposals: at most `most`, each with a value above `least`."""
        values = np.where(self._analysable([]), value.of(self.rows.cells), 0.0)
        order = np.argsort(-values, kind="stable")[:most].tolist()
        return [(k, float(values[k])) for k in order if values[k] > least]

    def greedy(self, value: Value, least: Callable[[int], float]) -> list[tuple[int, float]]:
        """A set chosen one by one, each the best per position given those before it, with the value that each adds.

        **Arguments:**

        - `least`: the value below which nothing is added, for a number of positions of the proposal.
        """
        chosen: list[tuple[int, float]] = []
        spent, open_ = 0, set(range(len(self.listed)))
        costs = np.array([proposal.cost for proposal in self.listed])
        while not value.enough:
            usable = self._analysable([k for k, _ in chosen])
            fits = [k for k in sorted(open_) if costs[k] <= MOST_IN_SET - spent and usable[k]]
            if not fits:
                break
            cells = [self.rows.cells[k] for k in fits]
            values = value.of(cells)
            best = int(np.argmax(value.per_position(cells, values)))
            if values[best] < least(int(costs[fits[best]])):
                break
            chosen.append((fits[best], float(values[best])))
            value.take(self.rows.cells[fits[best]])
            spent += int(costs[fits[best]])
            # The same position is not proposed twice: a turn of four is part of that of eight.
            same = self.listed[fits[best]]
            open_ -= {
                k
                for k in open_
                if (self.listed[k].side, self.listed[k].beta_deg) == (same.side, same.beta_deg)
                and set(self.listed[k].alpha_deg) & set(same.alpha_deg)
            }
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
