"""A slip made in setting up, as it is told."""

from dataclasses import dataclass

import numpy as np

from tumblecal.data import PositionSet
from tumblecal.estimation.fit import Fit


@dataclass(frozen=True)
class SetupError:
    """A mix-up found and put right: catalogue id, what it is in words; `equal`: ids and words of other slips that would
    leave the same data."""

    label: str
    words: str
    equal: tuple[tuple[str, str], ...] = ()

    @property
    def description(self) -> str:
        """The words with those of equal slips."""
        same = "; or ".join(words for _, words in self.equal)
        return f"{self.words} (or, which is the same here: {same})" if same else self.words

    def record(self) -> dict:
        """As JSON files hold it."""
        equal = [{"id": label, "words": words} for label, words in self.equal]
        return {"id": self.label, "words": self.words, "equal": equal}


# A setting is where it was written when the pitch error fitted there leaves less than this share of the slip.
_UNDONE = 0.3

# Mix-ups that no calibration at rest depends on.
HARMLESS = ("temperature_unit", "time_restarts")


def undone_by_fit(written: PositionSet, fit: Fit) -> bool:
    """Whether the pitch errors of a fit turn every setting that was put right back to where it was written: something else
    looked like the slip.

    **Arguments:**

    - `written`: the positions as they were, in the rows of the fit's problem.
    """
    where = fit.problem.where
    slips = np.asarray(where.beta) - written.beta
    moved = np.flatnonzero(np.abs(slips) > 0.0)
    leaf = next((leaf for leaf in fit.problem.chain.free if leaf.name == "dbeta"), None)
    if not len(moved) or leaf is None or leaf.by is None or not np.array_equal(np.asarray(where.alpha), written.alpha):
        return False
    errors = np.array([fit.value(name) for name in leaf.names])[np.asarray(where.index(leaf.by))[moved]]
    return bool(np.all(np.abs(slips[moved] + errors) < _UNDONE * np.abs(slips[moved])))
