"""An error in the set-up of a measurement, as it is reported."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tumblecal.data import PositionSet
from tumblecal.estimation.fit import Fit
from tumblecal.ground.numbers_shown import shortened
from tumblecal.ground.record import ResultRecord, at, by_name


@dataclass(frozen=True)
class SetupError:
    """A set-up error found and corrected.

    `label`: catalogue id. `words`: the error in words. `equal`: ids and words of other set-up errors that produce the
    same data.
    """

    label: str
    words: str
    equal: tuple[tuple[str, str], ...] = ()

    @property
    def description(self) -> str:
        """The words, followed by those of the indistinguishable errors."""
        same = "; or ".join(words for _, words in self.equal)
        return f"{self.words} (indistinguishable here: {same})" if same else self.words


class EqualErrorRecord(ResultRecord):
    """A set-up error that produces the same data."""

    id: str
    words: str


class SetupErrorRecord(ResultRecord):
    """`SetupError` in JSON files."""

    id: str = at("label")
    words: str
    equal: list[Annotated[EqualErrorRecord, by_name(("id", "words"))]]


def named(data: PositionSet, rows: Sequence[int] | np.ndarray) -> str:
    """The names of positions in a message, at most six."""
    return shortened([data.names[row] for row in rows], 6)


# The fit undoes a correction if the fitted pitch error leaves less than this share of it.
_UNDONE = 0.3

# Set-up errors without effect on a calibration at rest.
HARMLESS = ("temperature_unit", "time_restarts")


def undone_by_fit(written: PositionSet, fit: Fit) -> bool:
    """Whether the fitted pitch errors undo the correction of every pitch setting, so that the set-up error is not real.

    **Arguments:**

    - `written`: the positions before the correction, in the rows of the fit's problem.
    """
    where = fit.problem.where
    corrections = np.asarray(where.beta) - written.beta
    moved = np.flatnonzero(np.abs(corrections) > 0.0)
    leaf = next((leaf for leaf in fit.problem.chain.free if leaf.name == "dbeta"), None)
    if not len(moved) or leaf is None or leaf.by is None or not np.array_equal(np.asarray(where.alpha), written.alpha):
        return False
    errors = np.array([fit.value(name) for name in leaf.names])[np.asarray(where.index(leaf.by))[moved]]
    return bool(np.all(np.abs(corrections[moved] + errors) < _UNDONE * np.abs(corrections[moved])))
