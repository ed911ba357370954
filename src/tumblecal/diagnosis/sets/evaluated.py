"""The sets of causes that a search has evaluated, by their number of members, with their scores."""

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.sets.cause_sets import MOST, Members, keys_of


# Sets of one size as rows of sorted indices, and their scores.
_Scored = tuple[Int[np.ndarray, "sets size"], Float[np.ndarray, " sets"]]


class Evaluated:
    """Sets with their scores, first the empty set with the score `null`.

    - `best`, `leading`: the best score of each size, and its set.
    """

    def __init__(self, null: float):
        self.best: list[float] = [null, *[-np.inf] * MOST]
        self.leading: list[Members] = [()] * (MOST + 1)
        # Batch by batch.
        self._kept: list[list[_Scored]] = [[(np.zeros((1, 0), int), np.array([null]))], *([] for _ in range(MOST))]

    @property
    def top(self) -> float:
        """The best score."""
        return max(self.best)

    @property
    def best_size(self) -> int:
        """The size of the best set."""
        return max(range(MOST + 1), key=self.best.__getitem__)

    def add(self, sets: Int[np.ndarray, "sets most"], scores: Float[np.ndarray, " sets"]) -> None:
        """Add scored sets, rows of indices and -1; the empty set is there already."""
        # -1 as the largest number.
        sets, sizes = np.sort(sets.view(np.uint64), axis=1).view(np.int64), (sets >= 0).sum(axis=1)
        for size in set(sizes.tolist()) - {0}:
            own = sizes == size
            rows, of_size = sets[own, :size], scores[own]
            self._kept[size].append((rows, of_size))
            best = int(of_size.argmax())
            if of_size[best] > self.best[size]:
                self.best[size], self.leading[size] = float(of_size[best]), tuple(rows[best].tolist())

    def of_size(self, size: int) -> _Scored:
        """The sets of a size, each once."""
        if len(self._kept[size]) > 1:
            sets, scores = (np.concatenate(own) for own in zip(*self._kept[size], strict=True))
            # A set reached by several ways has scores that differ a little (collinear parts): the best counts.
            keys = keys_of(sets)
            order = np.lexsort((-scores, keys))
            first = order[np.diff(keys[order], prepend=~keys[order[:1]]) != 0]
            self._kept[size] = [(sets[first], scores[first])]
        return self._kept[size][0] if self._kept[size] else (np.zeros((0, size), int), np.zeros(0))

    def score_of(self, members: Members) -> float | None:
        """The score of a set; None if it was not evaluated."""
        sets, scores = self.of_size(len(members))
        own = scores[(sets == np.array(sorted(members), int)).all(axis=1)]
        return float(own.max()) if len(own) else None

    def no_less_than(self, least: float) -> tuple[Int[np.ndarray, "sets most"], Float[np.ndarray, " sets"]]:
        """The sets with at least this score, as rows that end in -1, and their scores."""
        of_sizes = [self.of_size(size) for size in range(MOST + 1)]
        scores = np.concatenate([own for _, own in of_sizes])
        sets, first = np.full((len(scores), MOST), -1), 0
        for size, (rows, _) in enumerate(of_sizes):
            sets[first : first + len(rows), :size] = rows
            first += len(rows)
        return sets[scores >= least], scores[scores >= least]
