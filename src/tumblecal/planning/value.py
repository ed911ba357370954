"""Information gain of new positions: separation of explanations, or reduction of the largest uncertainty.

Both use information matrices, to which the positions of a set are added one by one. The value of every proposal given those
already in the set costs a few small products.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from tumblecal.planning.alternatives import Alternative
from tumblecal.planning.new_rows import Rows


# Information on parameters that nothing determines yet, as a share of the largest: practically none.
_NOTHING = 1e-10
# Separated: the odds of the alternatives together are expected to fall by e^10, so that they almost always fall by e^4.
DECIDED = 10.0


class Value(Protocol):
    """The information gain of positions for one purpose."""

    def of(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, " proposals"]:
        """Value of each proposal (its cells) given those in the set."""
        ...

    def per_position(self, cells: Sequence[np.ndarray], values: np.ndarray) -> Float[np.ndarray, " proposals"]:
        """Value of each proposal in an additive measure, per position."""
        ...

    def take(self, cells: np.ndarray) -> None:
        """Measure these positions."""
        ...

    @property
    def total(self) -> float:
        """Value of the whole set."""
        ...

    @property
    def enough(self) -> bool:
        """Whether the set is sufficient."""
        ...


class LinearPosterior:
    """Linear posterior of some columns: information matrix, rows of the cells, and projection of the signal in the data."""

    def __init__(self, rows: Rows, columns: Sequence[int], signal: np.ndarray | None = None):
        of_groups = np.arange(len(rows.group_prior)) + rows.old.shape[1] - len(rows.group_prior)
        chosen = [*columns, *of_groups.tolist()]
        old, self.new = rows.old[:, chosen], rows.new[:, :, chosen]
        self.information = old.T @ old
        prior = np.concatenate([np.zeros(len(columns)), rows.group_prior])
        nothing = _NOTHING * np.max(np.diag(self.information))
        self.information += np.diag(np.maximum(prior, nothing))
        self.towards = np.zeros(len(chosen)) if signal is None else old.T @ signal

    def covariance(self) -> np.ndarray:
        """Covariance of the parameters of the columns."""
        return np.linalg.inv(self.information)

    def take(self, cells: np.ndarray, shown: np.ndarray | None = None) -> None:
        """Add these cells; `shown`: their readings."""
        rows = self.new[cells].reshape(-1, self.new.shape[-1])
        self.information = self.information + rows.T @ rows
        if shown is not None:
            self.towards = self.towards + rows.T @ shown


def _batches(cells: Sequence[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Proposals with the same number of cells: their numbers, and their cells (proposals, cells)."""
    counts = np.array([len(each) for each in cells])
    return [
        (np.flatnonzero(counts == count), np.stack([cells[k] for k in np.flatnonzero(counts == count).tolist()]))
        for count in sorted(set(counts.tolist()))
    ]


class Separation:
    """Expected log Bayes factor of the leader against its alternatives together.

    Every explanation predicts new readings as a normal distribution, by its fit to the data with the uncertainty of all its
    coefficients. Against one alternative the expected log Bayes factor is the Kullback-Leibler divergence of its distribution
    from the leader's. Several alternatives are weighted by their posterior odds: the value is the expected decrease of the log
    of the sum of their odds.

    **Arguments:**

    - `nominal`: number of nominal columns.
    - `leader`: its columns, with its rows. `amplitudes`: its coefficients (scaled).
    - `alternatives`: to the leader.
    """

    explanations: list[LinearPosterior]
    labels: list[tuple[str, ...]]
    most: float

    def __init__(self, nominal: int, leader: Alternative, amplitudes: np.ndarray, alternatives: Sequence[Alternative]):
        columns = list(leader.columns)
        # The data before the effects of the leader are subtracted.
        shown = leader.rows.residual + leader.rows.old[:, columns] @ amplitudes
        self.explanations = [
            LinearPosterior(one.rows, [*range(nominal), *one.columns], shown) for one in (leader, *alternatives)
        ]
        self.labels = [alternative.labels for alternative in alternatives]
        self.log_odds = np.log([alternative.odds for alternative in alternatives])
        self.gained, self.most = np.zeros(len(alternatives)), 0.0

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
        """Log Bayes factor per position, as far as it is needed for a decision."""
        return np.minimum(values, max(DECIDED - self._without_one, 0.0)) / np.array([len(each) for each in cells])

    def take(self, cells: np.ndarray) -> None:
        """Add these positions to the set."""
        before = self.total
        self.gained = self.gained + self._gains([cells])[:, 0]
        # Their expected readings are the prediction of the leader.
        expected = self.predictions(cells[None])[0][0][0]
        for known in self.explanations:
            known.take(cells, expected)
        self.most = max(self.most, (self.total - before) / len(cells))

    @property
    def enough(self) -> bool:
        """Whether the alternatives are separated even if one position of the set turns out to be an outlier."""
        return self._without_one >= DECIDED

    @property
    def _without_one(self) -> float:
        """The total without the position that adds most."""
        return self.total - self.most

    @property
    def total(self) -> float:
        """Expected log Bayes factor of the whole set."""
        return float(self._total(self.gained[:, None])[0])

    def _total(self, gains: Float[np.ndarray, "alternatives proposals"]) -> Float[np.ndarray, " proposals"]:
        fallen = np.logaddexp.reduce(self.log_odds[:, None] - gains, axis=0)
        return np.logaddexp.reduce(self.log_odds) - fallen

    def inseparable(self, cells: Sequence[np.ndarray]) -> list[int]:
        """Numbers of the alternatives that even all proposals together would not separate from the leader."""
        leader, *others = self.explanations
        rows = leader.new[np.concatenate(cells)].reshape(-1, leader.new.shape[-1])
        expected = rows @ (leader.covariance() @ leader.towards)
        inseparable = []
        for k, known in enumerate(others):
            rows = known.new[np.concatenate(cells)].reshape(len(expected), -1)
            rest = expected - rows @ (known.covariance() @ known.towards)
            seen = rows.T @ rest
            remaining = rest @ rest - seen @ np.linalg.solve(known.information + rows.T @ rows, seen)
            if 0.5 * remaining < 1.0:
                inseparable.append(k)
        return inseparable

    def _gains(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, "alternatives proposals"]:
        """Expected log Bayes factor against each alternative that each proposal adds."""
        gains = np.zeros((len(self.log_odds), len(cells)))
        for numbers, batch in _batches(cells):
            (mean, spread), *others = self.predictions(batch)
            leader_volume = np.linalg.slogdet(spread)[1]
            for k, (other_mean, other_spread) in enumerate(others):
                rest = (mean - other_mean)[:, :, None]
                solved = np.linalg.solve(other_spread, np.concatenate([spread, rest], axis=2))
                traces = np.trace(solved[:, :, :-1], axis1=1, axis2=2) - mean.shape[1]
                squares = np.sum(rest[:, :, 0] * solved[:, :, -1], axis=1)
                volumes = np.linalg.slogdet(other_spread)[1] - leader_volume
                gains[k, numbers] = 0.5 * (traces + squares + volumes)
        return np.maximum(gains, 0.0)


class Sharpening:
    """Relative reduction of the largest standard uncertainty.

    **Arguments:**

    - `rows`: of old and new positions.
    - `columns`: those fitted. `watched`: places among them of the relevant parameters, each in its scale.
    """

    known: LinearPosterior
    watched: list[int]

    def __init__(self, rows: Rows, columns: Sequence[int], watched: Sequence[int]):
        self.known, self.watched = LinearPosterior(rows, columns), list(watched)
        self.first = self.variances()

    def variances(self) -> Float[np.ndarray, " watched"]:
        """Variances of the watched parameters, scaled."""
        return np.diag(self.known.covariance())[self.watched]

    def of(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, " proposals"]:
        """Relative reduction of the largest standard uncertainty by each proposal."""
        covariance = self.known.covariance()
        values = np.zeros(len(cells))
        before = np.diag(covariance)[self.watched]
        for numbers, batch in _batches(cells):
            rows = self.known.new[batch].reshape(len(batch), -1, len(covariance))
            spread = rows @ covariance @ rows.transpose(0, 2, 1) + np.eye(rows.shape[1])
            across = rows @ covariance[:, self.watched]
            less = np.sum(across * np.linalg.solve(spread, across), axis=1)
            values[numbers] = 1.0 - np.sqrt(np.max(np.maximum(before - less, 0.0), axis=1) / np.max(before))
        return values

    def per_position(self, cells: Sequence[np.ndarray], values: np.ndarray) -> Float[np.ndarray, " proposals"]:
        """Decrease of the logarithm of the uncertainty per position."""
        return -np.log1p(-np.minimum(values, 1 - 1e-12)) / np.array([len(each) for each in cells])

    def take(self, cells: np.ndarray) -> None:
        """Add these positions to the set."""
        self.known.take(cells)

    @property
    def enough(self) -> bool:
        """Never: the steps only become small."""
        return False

    @property
    def total(self) -> float:
        """Relative reduction of the largest standard uncertainty by the whole set."""
        return float(1.0 - np.sqrt(np.max(self.variances()) / np.max(self.first)))
