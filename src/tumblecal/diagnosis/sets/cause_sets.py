"""Sets of causes: tuples of indices into a pool, in ascending order, or rows of them that end in -1."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from tumblecal.diagnosis.tuning import SIZE_PRIOR


Members = tuple[int, ...]
MOST = len(SIZE_PRIOR) - 1


def rows_of(sets: Sequence[Members], most: int = MOST) -> Int[np.ndarray, "sets most"]:
    """Sets of up to `most` causes as rows."""
    return np.array([(*members, *[-1] * (most - len(members))) for members in sets], np.int64).reshape(len(sets), most)


def sets_of(rows: Int[np.ndarray, "sets most"]) -> list[Members]:
    """The sets of rows."""
    sizes = np.sum(rows >= 0, axis=1).tolist()
    return [tuple(row[:size]) for row, size in zip(rows.tolist(), sizes, strict=True)]


def keys_of(sets: Int[np.ndarray, "sets size"]) -> np.ndarray:
    """One number for each row of up to four indices (-1: none) below 65535."""
    keys = np.zeros(len(sets), np.uint64)
    for column in range(sets.shape[1]):
        keys = (keys << np.uint64(16)) | (sets[:, column] & 0xFFFF).astype(np.uint64)
    return keys
