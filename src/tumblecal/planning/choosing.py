"""The proposals chosen by their value: the best each for itself, and a set that goes well together."""

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
    """What is chosen from: `listed` proposals with their `rows`."""

    listed: list[Proposal]
    rows: Rows

    def best(self, value: Value, most: int, least: float) -> list[tuple[int, float]]:
        """Numbers and values of the best proposals, each for itself: at most so many, each worth more than `least`."""
        values = np.where(self._usable([]), value.of(self.rows.cells), 0.0)
        order = np.argsort(-values, kind="stable")[:most].tolist()
        return [(k, float(values[k])) for k in order if values[k] > least]

    def greedy(self, value: Value, least: Callable[[int], float]) -> list[tuple[int, float]]:
        """Proposals taken one by one, each the best per position beside those before it, and what each adds.

        **Arguments:**

        - `least`: the value below which nothing is added, by the number of positions of the proposal.
        """
        taken: list[tuple[int, float]] = []
        spent, open_ = 0, set(range(len(self.listed)))
        costs = np.array([proposal.cost for proposal in self.listed])
        while not value.enough:
            usable = self._usable([k for k, _ in taken])
            fits = [k for k in sorted(open_) if costs[k] <= MOST_IN_SET - spent and usable[k]]
            if not fits:
                break
            own = [self.rows.cells[k] for k in fits]
            values = value.of(own)
            best = int(np.argmax(value.per_position(own, values)))
            if values[best] < least(int(costs[fits[best]])):
                break
            taken.append((fits[best], float(values[best])))
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
        return taken

    def _usable(self, taken: list[int]) -> Bool[np.ndarray, " listed"]:
        """Which proposals can be analysed beside those taken: what is measured in a new mounting must tell how the triad stands
        in it."""
        own: dict[str, list[np.ndarray]] = {}
        for k in taken:
            own.setdefault(self.listed[k].side, []).append(self.rows.cells[k])
        return np.array(
            [
                not proposal.side or self.rows.determine_their_own(np.concatenate([*own.get(proposal.side, ()), cells]))
                for proposal, cells in zip(self.listed, self.rows.cells, strict=True)
            ],
            bool,
        )
