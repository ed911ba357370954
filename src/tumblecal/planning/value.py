"""What new positions are worth: how far they separate explanations, or how much they sharpen the worst parameter.

Both work on information matrices, to which a set of positions is added one by one; the value of every proposal beside
those already taken costs a few small products.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from jaxtyping import Float

from tumblecal.planning.new_rows import Rows
from tumblecal.planning.rivals import Rival


# Information on what nothing has determined yet, as a share of the largest there is: practically none.
_NOTHING = 1e-10
# Separated: the odds of the rivals together are expected to fall by e^5.
DECIDED = 5.0


class Value(Protocol):
    """What positions are good for."""

    def of(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, " proposals"]:
        """Value of each proposal (the cells of each) beside those taken so far."""
        ...

    def per_position(self, cells: Sequence[np.ndarray], values: np.ndarray) -> Float[np.ndarray, " proposals"]:
        """The same in a measure that adds up, per position measured."""
        ...

    def take(self, cells: np.ndarray) -> None:
        """Measure these positions."""
        ...

    @property
    def total(self) -> float:
        """Value of all that was taken."""
        ...

    @property
    def enough(self) -> bool:
        """Whether nothing more is needed."""
        ...


class Known:
    """What is known of some columns: information matrix; rows of the cells; the data's signal towards them."""

    def __init__(self, rows: Rows, columns: Sequence[int], signal: np.ndarray | None = None):
        own = np.arange(len(rows.own_prior)) + rows.old.shape[1] - len(rows.own_prior)
        chosen = [*columns, *own.tolist()]
        old, self.new = rows.old[:, chosen], rows.new[:, :, chosen]
        self.information = old.T @ old
        prior = np.concatenate([np.zeros(len(columns)), rows.own_prior])
        nothing = _NOTHING * np.max(np.diag(self.information))
        self.information += np.diag(np.maximum(prior, nothing))
        self.towards = np.zeros(len(chosen)) if signal is None else old.T @ signal

    def covariance(self) -> np.ndarray:
        """Of the columns' parameters."""
        return np.linalg.inv(self.information)

    def take(self, cells: np.ndarray, signal: np.ndarray | None = None) -> None:
        """Measure these cells, which show `signal`."""
        rows = self.new[cells].reshape(-1, self.new.shape[-1])
        self.information = self.information + rows.T @ rows
        if signal is not None:
            self.towards = self.towards + rows.T @ signal[cells].ravel()


def _batches(cells: Sequence[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Proposals with the same number of cells: their numbers, and their cells (proposals, cells)."""
    counts = np.array([len(own) for own in cells])
    return [
        (np.flatnonzero(counts == count), np.stack([cells[k] for k in np.flatnonzero(counts == count).tolist()]))
        for count in sorted(set(counts.tolist()))
    ]


class Separation:
    """Expected log Bayes factor of the leader against its rivals together.

    Against one rival it is half the squared norm of the part of the leader's signal that the rival, refitted to old and
    new positions together, cannot make. Several rivals count by their posterior odds: the value is how far the log of
    the sum of their odds is expected to fall.

    **Arguments:**

    - `rows`, `nominal`: rows, and number of nominal columns.
    - `leader`, `amplitudes`: the leader's columns, and what it says of them (scaled).
    - `rivals`: what else may be.
    """

    def __init__(
        self,
        rows: Rows,
        nominal: int,
        leader: Sequence[int],
        amplitudes: np.ndarray,
        rivals: Sequence[Rival],
    ):
        self.signal = rows.new[:, :, list(leader)] @ amplitudes
        old = rows.old[:, list(leader)] @ amplitudes
        self.known = [Known(rival.rows, [*range(nominal), *rival.columns], old) for rival in rivals]
        self.log_odds = np.log([rival.odds for rival in rivals])
        self.gained, self.most = np.zeros(len(rivals)), 0.0

    def of(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, " proposals"]:
        """Expected log Bayes factor that each proposal adds."""
        gains = np.stack([self._gains(known, cells) for known in self.known])
        left = self.log_odds - self.gained
        return np.logaddexp.reduce(left) - np.logaddexp.reduce(left[:, None] - gains, axis=0)

    def per_position(self, cells: Sequence[np.ndarray], values: np.ndarray) -> Float[np.ndarray, " proposals"]:
        """Log Bayes factor a position, as far as it is needed to decide."""
        return np.minimum(values, max(DECIDED - self._without_one, 0.0)) / np.array([len(own) for own in cells])

    def take(self, cells: np.ndarray) -> None:
        """Measure these positions."""
        before = self.total
        self.gained = self.gained + [self._gains(known, [cells])[0] for known in self.known]
        for known in self.known:
            known.take(cells, self.signal)
        self.most = max(self.most, (self.total - before) / len(cells))

    @property
    def enough(self) -> bool:
        """Whether the rivals are told apart, whatever single position of those taken turns out to be off itself."""
        return self._without_one >= DECIDED

    @property
    def _without_one(self) -> float:
        """The total without the position that adds most."""
        return self.total - self.most

    @property
    def total(self) -> float:
        """Expected log Bayes factor of all that was taken."""
        return float(np.logaddexp.reduce(self.log_odds) - np.logaddexp.reduce(self.log_odds - self.gained))

    def inseparable(self, cells: Sequence[np.ndarray]) -> list[int]:
        """Numbers of the rivals that even all proposals together would not tell from the leader."""
        everything = [np.concatenate(cells)]
        return [k for k, known in enumerate(self.known) if self._gains(known, everything)[0] < 1.0]

    def _gains(self, known: Known, cells: Sequence[np.ndarray]) -> np.ndarray:
        covariance = known.covariance()
        fitted = covariance @ known.towards
        gains = np.zeros(len(cells))
        for numbers, own in _batches(cells):
            rows = known.new[own].reshape(len(own), -1, len(fitted))
            rest = self.signal[own].reshape(len(own), -1) - rows @ fitted
            spread = rows @ covariance @ rows.transpose(0, 2, 1) + np.eye(rows.shape[1])
            gains[numbers] = 0.5 * np.sum(rest * np.linalg.solve(spread, rest[:, :, None])[:, :, 0], axis=1)
        return gains


class Sharpening:
    """The share by which the worst standard deviation falls.

    **Arguments:**

    - `rows`: of old and new positions.
    - `columns`: those fitted. `watched`: places among them of the parameters that count, each in its own scale.
    """

    def __init__(self, rows: Rows, columns: Sequence[int], watched: Sequence[int]):
        self.known, self.watched = Known(rows, columns), list(watched)
        self.first = self.variances()

    def variances(self) -> Float[np.ndarray, " watched"]:
        """Of the watched parameters, scaled."""
        return np.diag(self.known.covariance())[self.watched]

    def of(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, " proposals"]:
        """The share of the worst sd that each proposal takes away."""
        covariance = self.known.covariance()
        values = np.zeros(len(cells))
        before = np.diag(covariance)[self.watched]
        for numbers, own in _batches(cells):
            rows = self.known.new[own].reshape(len(own), -1, len(covariance))
            spread = rows @ covariance @ rows.transpose(0, 2, 1) + np.eye(rows.shape[1])
            across = rows @ covariance[:, self.watched]
            less = np.sum(across * np.linalg.solve(spread, across), axis=1)
            values[numbers] = 1.0 - np.sqrt(np.max(np.maximum(before - less, 0.0), axis=1) / np.max(before))
        return values

    def per_position(self, cells: Sequence[np.ndarray], values: np.ndarray) -> Float[np.ndarray, " proposals"]:
        """Fall of the sd's logarithm a position."""
        return -np.log1p(-np.minimum(values, 1 - 1e-12)) / np.array([len(own) for own in cells])

    def take(self, cells: np.ndarray) -> None:
        """Measure these positions."""
        self.known.take(cells)

    @property
    def enough(self) -> bool:
        """Never: the steps become small."""
        return False

    @property
    def total(self) -> float:
        """The share of the worst sd that all taken together take away."""
        return float(1.0 - np.sqrt(np.max(self.variances()) / np.max(self.first)))
