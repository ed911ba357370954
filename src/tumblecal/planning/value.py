"""What new positions are worth: how far they separate explanations, or how much they sharpen the worst parameter.

Both work on information matrices, to which a set of positions is added one by one; the value of every proposal beside
those already taken costs a few small products.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from tumblecal.planning.new_rows import Rows
from tumblecal.planning.rivals import Rival


# Information on what nothing has determined yet, as a share of the largest there is: practically none.
_NOTHING = 1e-10
# Separated: the odds of the rivals together are expected to fall by e^10, so that they nearly always fall by e^4.
DECIDED = 10.0


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

    def take(self, cells: np.ndarray, shown: np.ndarray | None = None) -> None:
        """Measure these cells, which show `shown`."""
        rows = self.new[cells].reshape(-1, self.new.shape[-1])
        self.information = self.information + rows.T @ rows
        if shown is not None:
            self.towards = self.towards + rows.T @ shown


def _batches(cells: Sequence[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Proposals with the same number of cells: their numbers, and their cells (proposals, cells)."""
    counts = np.array([len(own) for own in cells])
    return [
        (np.flatnonzero(counts == count), np.stack([cells[k] for k in np.flatnonzero(counts == count).tolist()]))
        for count in sorted(set(counts.tolist()))
    ]


class Separation:
    """Expected log Bayes factor of the leader against its rivals together.

    Every explanation predicts new readings as a normal distribution: its own fit to the data, with the uncertainty of all its
    coefficients. Against one rival the expected log Bayes factor is the Kullback-Leibler divergence of its distribution from
    the leader's. Several rivals count by their posterior odds: the value is how far the log of the sum of their odds is
    expected to fall.

    **Arguments:**

    - `nominal`: number of nominal columns.
    - `leader`: its columns, with its rows. `amplitudes`: what it says of them (scaled).
    - `rivals`: what else may be.
    """

    def __init__(self, nominal: int, leader: Rival, amplitudes: np.ndarray, rivals: Sequence[Rival]):
        columns = list(leader.columns)
        # The data, as they are without the leader's effects.
        shown = leader.rows.residual + leader.rows.old[:, columns] @ amplitudes
        self.explanations = [Known(own.rows, [*range(nominal), *own.columns], shown) for own in (leader, *rivals)]
        self.labels = [rival.labels for rival in rivals]
        self.log_odds = np.log([rival.odds for rival in rivals])
        self.gained, self.most = np.zeros(len(rivals)), 0.0

    def predictions(
        self, cells: Int[np.ndarray, "proposals cells"]
    ) -> list[tuple[Float[np.ndarray, "proposals rows"], Float[np.ndarray, "proposals rows rows"]]]:
        """Mean and covariance of the readings at each proposal's cells by each explanation, the leader first, in units of the
        noise."""
        predicted = []
        for known in self.explanations:
            covariance = known.covariance()
            rows = known.new[cells].reshape(len(cells), -1, len(covariance))
            spread = rows @ covariance @ rows.transpose(0, 2, 1) + np.eye(rows.shape[1])
            predicted.append((rows @ (covariance @ known.towards), spread))
        return predicted

    def of(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, " proposals"]:
        """Expected log Bayes factor that each proposal adds."""
        return self._total(self.gained[:, None] + self._gains(cells)) - self.total

    def per_position(self, cells: Sequence[np.ndarray], values: np.ndarray) -> Float[np.ndarray, " proposals"]:
        """Log Bayes factor a position, as far as it is needed to decide."""
        return np.minimum(values, max(DECIDED - self._without_one, 0.0)) / np.array([len(own) for own in cells])

    def take(self, cells: np.ndarray) -> None:
        """Measure these positions."""
        before = self.total
        self.gained = self.gained + self._gains([cells])[:, 0]
        # The leader's own prediction is what they are expected to show.
        expected = self.predictions(cells[None])[0][0][0]
        for known in self.explanations:
            known.take(cells, expected)
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
        return float(self._total(self.gained[:, None])[0])

    def _total(self, gains: Float[np.ndarray, "rivals proposals"]) -> Float[np.ndarray, " proposals"]:
        fallen = np.logaddexp.reduce(self.log_odds[:, None] - gains, axis=0)
        return np.logaddexp.reduce(self.log_odds) - fallen

    def inseparable(self, cells: Sequence[np.ndarray]) -> list[int]:
        """Numbers of the rivals that even all proposals together would not tell from the leader."""
        leader, *others = self.explanations
        rows = leader.new[np.concatenate(cells)].reshape(-1, leader.new.shape[-1])
        expected = rows @ (leader.covariance() @ leader.towards)
        inseparable = []
        for k, known in enumerate(others):
            rows = known.new[np.concatenate(cells)].reshape(len(expected), -1)
            rest = expected - rows @ (known.covariance() @ known.towards)
            seen = rows.T @ rest
            left = rest @ rest - seen @ np.linalg.solve(known.information + rows.T @ rows, seen)
            if 0.5 * left < 1.0:
                inseparable.append(k)
        return inseparable

    def _gains(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, "rivals proposals"]:
        """Expected log Bayes factor against each rival that each proposal adds."""
        gains = np.zeros((len(self.log_odds), len(cells)))
        for numbers, own in _batches(cells):
            (mean, spread), *others = self.predictions(own)
            own_volume = np.linalg.slogdet(spread)[1]
            for k, (other_mean, other_spread) in enumerate(others):
                rest = (mean - other_mean)[:, :, None]
                solved = np.linalg.solve(other_spread, np.concatenate([spread, rest], axis=2))
                traces = np.trace(solved[:, :, :-1], axis1=1, axis2=2) - mean.shape[1]
                squares = np.sum(rest[:, :, 0] * solved[:, :, -1], axis=1)
                volumes = np.linalg.slogdet(other_spread)[1] - own_volume
                gains[k, numbers] = 0.5 * (traces + squares + volumes)
        return np.maximum(gains, 0.0)


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
