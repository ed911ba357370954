"""Which line of a text table each of its rows stands in: comments and blank lines stand between them."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    import polars as pl


def _none() -> np.ndarray:
    return np.zeros(0, int)


@dataclass(frozen=True)
class RowLines:
    """Lines from 1: `first` is that from which on the rows stand; `comments` and `blank` are the lines that hold none."""

    first: int = 1
    comments: np.ndarray = field(default_factory=_none)
    blank: np.ndarray = field(default_factory=_none)

    @cached_property
    def _rows_before(self) -> np.ndarray:
        """How many rows stand before each line below the header that holds none."""
        passed = np.sort(np.concatenate([self.comments, self.blank]))
        passed = passed[passed >= self.first]
        return passed - self.first - np.arange(len(passed))

    @cached_property
    def _blank_rows(self) -> np.ndarray:
        """The blank lines by their numbers among rows and blank lines, from 0."""
        comments = self.comments[self.comments >= self.first]
        blank = self.blank[self.blank >= self.first]
        return blank - self.first - np.searchsorted(comments, blank)

    def line_of(self, row: int) -> int:
        """The line of a row (from 0; blank lines are none)."""
        return self.first + row + int(np.searchsorted(self._rows_before, row, side="right"))

    def without_blank(self, path: Path, frame: "pl.DataFrame", before: int = 0) -> "pl.DataFrame":
        """A piece of a table without its blank lines, which its reader takes for rows; `before` of these stand ahead of it.

        **Raises:** `InputError` where cells that go over several lines make the lines uncertain.
        """
        import polars as pl

        start, stop = np.searchsorted(self._blank_rows, [before, before + len(frame)])
        if start == stop:
            return frame
        at = self._blank_rows[start:stop] - before
        blank = frame[at]
        if blank.select(pl.any_horizontal(pl.all().str.strip_chars(" \t\r,;").fill_null("") != "").any()).item():
            raise InputError(
                f"{path}: cells that go over several lines and blank lines beside them; take the blank lines out"
            )
        kept = np.ones(len(frame), bool)
        kept[at] = False
        return frame.filter(pl.Series(kept))
