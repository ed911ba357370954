"""Sets of causes: tuples of indices into a pool, in ascending order, or rows of them that end in -1."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.full_model.priors import SIZE_PRIOR


Members = tuple[int, ...]
# A set counts for at most so many causes. Axes of a family are one cause, and so are outlying positions: it may have more
# members, three families and another cause.
MOST_CAUSES = len(SIZE_PRIOR) - 1
MOST = 10
_FEWEST_NUMBERS = 1 << 12


def rows_of(sets: Sequence[Members], most: int = MOST) -> Int[np.ndarray, "sets most"]:
    """Sets of up to `most` causes as rows."""
    return np.array([(*members, *[-1] * (most - len(members))) for members in sets], np.int64).reshape(len(sets), most)


def sets_of(rows: Int[np.ndarray, "sets most"]) -> list[Members]:
    """The sets of rows."""
    sizes = np.sum(rows >= 0, axis=1).tolist()
    return [tuple(row[:size]) for row, size in zip(rows.tolist(), sizes, strict=True)]


def parts_of(members: Members) -> list[Members]:
    """A set and its parts, the smallest first: all, of more members than causes nothing and those that lack up to two."""
    sizes = range(len(members) + 1)
    if len(members) > MOST_CAUSES:
        sizes = (0, *sizes[-3:])
    return [part for size in sizes for part in combinations(members, size)]


def keys_of(sets: Int[np.ndarray, "sets size"]) -> np.ndarray:
    """One number for each row of indices (-1: none), independent of their order, for rows that are compared with each other:
    two of a million sets have the same once in 10^7 times."""
    return _numbers(max(_FEWEST_NUMBERS, 1 << int(sets.max(initial=0)).bit_length()))[sets].sum(axis=1)


@lru_cache(maxsize=4)
def _numbers(count: int) -> np.ndarray:
    """A random number for each of so many indices, and 0 for -1."""
    return np.append(np.random.default_rng(0).integers(1 << 63, size=count, dtype=np.uint64), np.uint64(0))


class Ranked(NamedTuple):
    """Sets of candidates with their unnormalised log posteriors, best first; rows of `members` end in -1."""

    members: Int[np.ndarray, "sets most"]
    log_posterior: Float[np.ndarray, " sets"]

    def set_at(self, rank: int) -> Members:
        """The candidates of the set of this rank."""
        return sets_of(self.members[rank : rank + 1])[0]
