"""Information gain of new positions: separation of explanations, or reduction of the largest uncertainty.

Both use information matrices, to which the positions of a set are added one by one. The value of every proposal given those
already in the set costs a few small products.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float, Int

from tumblecal.planning.alternatives import Predicted
from tumblecal.planning.new_rows import Rows


# Information on parameters that nothing determines yet, as a share of the largest: practically none.
_NOTHING = 1e-10
# Separated: the odds of the alternatives together are expected to fall by e^20, so that they almost always fall by e^4, also
# against sets of causes that are not listed.
DECIDED = 20.0


# Mean and covariance of the readings of each proposal.
Prediction = tuple[Float[np.ndarray, "proposals rows"], Float[np.ndarray, "proposals rows rows"]]


class LinearPosterior:
    """Linear posterior of some columns, and of those that only new groups have: information matrix, rows of the cells,
    readings of the cells without these parameters, and projection of the data."""

    def __init__(self, rows: Rows, columns: Sequence[int]):
        chosen = [*columns, *range(rows.old.shape[1] - rows.own, rows.old.shape[1])]
        old, self.new, self.expected = rows.old[:, chosen], rows.new[:, :, chosen], rows.expected
        self.information = old.T @ old
        nothing = _NOTHING * np.max(np.diag(self.information))
        self.information += np.diag(np.maximum(rows.prior[chosen], nothing))
        self.towards = old.T @ rows.shown

    def covariance(self) -> np.ndarray:
        """Covariance of the parameters of the columns."""
        return np.linalg.inv(self.information)

    def take(self, cells: np.ndarray, readings: Float[np.ndarray, " rows"]) -> None:
        """Add these cells with their readings."""
        rows = self.new[cells].reshape(-1, self.new.shape[-1])
        self.information = self.information + rows.T @ rows
        self.towards = self.towards + rows.T @ (readings - self.expected[cells].ravel())

    def predicted(self, cells: Int[np.ndarray, "proposals cells"]) -> Prediction:
        """Mean and covariance of the readings at each proposal's cells, in units of the noise."""
        covariance = self.covariance()
        rows = self.new[cells].reshape(len(cells), -1, len(covariance))
        mean = self.expected[cells].reshape(len(cells), -1) + rows @ (covariance @ self.towards)
        return mean, rows @ covariance @ rows.transpose(0, 2, 1) + np.eye(rows.shape[1])


def _batches(cells: Sequence[np.ndarray]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Proposals with the same number of cells: their numbers, and their cells (proposals, cells)."""
    counts = np.array([len(each) for each in cells])
    for count in np.unique(counts):
        numbers = np.flatnonzero(counts == count)
        yield numbers, np.stack([cells[k] for k in numbers.tolist()])


class Separation:
    """Expected log Bayes factor of the leader against its alternatives together.

    Every explanation predicts new readings as a normal distribution, by its fit to the data with the uncertainty of all its
    coefficients. Against one alternative the expected log Bayes factor is the smaller Kullback-Leibler divergence between its
    distribution and the leader's: either may be true. Several alternatives are weighted by their posterior odds: the value is
    the expected decrease of the log of the sum of their odds.

    **Arguments:**

    - `competing`: the explanations, the leading one first.
    """

    def __init__(self, competing: Sequence[Predicted]):
        self.explanations = [LinearPosterior(one.rows, one.columns) for one in competing]
        leader, *others = (one.by for one in competing)
        self.labels, self.larger = [one.labels for one in others], [one.larger for one in (leader, *others)]
        self.log_odds = np.log([one.probability / leader.probability for one in others])
        self.gained, self.most = np.zeros(len(self.labels)), 0.0

    def of(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, " proposals"]:
        """Expected log Bayes factor that each proposal adds."""
        return self._total(self.gained[:, None] + self._gains(cells)) - self.total

    def per_position(self, cells: Sequence[np.ndarray], values: np.ndarray) -> Float[np.ndarray, " proposals"]:
        """Log Bayes factor per position, as far as it is needed for a decision."""
        return np.minimum(values, self._lacking) / np.array([len(each) for each in cells])

    def take(self, cells: np.ndarray) -> None:
        """Add these positions to the set."""
        before = self.total
        self.gained = self.gained + self._gains([cells])[:, 0]
        # Their expected readings are the prediction of the leader.
        expected = self.explanations[0].predicted(cells[None])[0][0]
        for known in self.explanations:
            known.take(cells, expected)
        self.most = max(self.most, (self.total - before) / len(cells))

    @property
    def enough(self) -> bool:
        """Whether the alternatives are separated even if one position of the set turns out to be an outlier."""
        return self._lacking == 0.0

    @property
    def _lacking(self) -> float:
        """What the total without the position that adds most lacks."""
        return max(DECIDED - self.total + self.most, 0.0)

    @property
    def total(self) -> float:
        """Expected log Bayes factor of the whole set."""
        return float(self._total(self.gained[:, None])[0])

    def _total(self, gains: Float[np.ndarray, "alternatives proposals"]) -> Float[np.ndarray, " proposals"]:
        fallen = np.logaddexp.reduce(self.log_odds[:, None] - gains, axis=0)
        return np.logaddexp.reduce(self.log_odds) - fallen

    def inseparable(self, cells: Sequence[np.ndarray]) -> list[int]:
        """Numbers of the alternatives that even all proposals together would not separate from the leader."""
        (expected, _), *others = (known.predicted(np.concatenate(cells)[None]) for known in self.explanations)
        rests = [(expected[0] - mean[0], spread[0]) for mean, spread in others]
        return [k for k, (rest, spread) in enumerate(rests) if 0.5 * rest @ np.linalg.solve(spread, rest) < 1.0]

    def _gains(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, "alternatives proposals"]:
        """Expected log Bayes factor between the leader and each alternative that each proposal adds, whichever of the two is
        true."""
        gains = np.zeros((len(self.log_odds), len(cells)))
        for numbers, batch in _batches(cells):
            leader, *others = (known.predicted(batch) for known in self.explanations)
            for k, other in enumerate(others):
                gains[k, numbers] = np.minimum(_divergence(leader, other), _divergence(other, leader))
        return np.maximum(gains, 0.0)


def _divergence(one: Prediction, other: Prediction) -> Float[np.ndarray, " proposals"]:
    """Kullback-Leibler divergence of another normal distribution from one."""
    (mean, spread), (other_mean, other_spread) = one, other
    rest = (mean - other_mean)[:, :, None]
    solved = np.linalg.solve(other_spread, np.concatenate([spread, rest], axis=2))
    traces = np.trace(solved[:, :, :-1], axis1=1, axis2=2) - mean.shape[1]
    squares = np.sum(rest[:, :, 0] * solved[:, :, -1], axis=1)
    volumes = np.linalg.slogdet(other_spread)[1] - np.linalg.slogdet(spread)[1]
    return 0.5 * (traces + squares + volumes)


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
            across = rows @ covariance[:, self.watched]
            less = np.sum(across * np.linalg.solve(self.known.predicted(batch)[1], across), axis=1)
            values[numbers] = 1.0 - np.sqrt(np.max(np.maximum(before - less, 0.0), axis=1) / np.max(before))
        return values

    def per_position(self, cells: Sequence[np.ndarray], values: np.ndarray) -> Float[np.ndarray, " proposals"]:
        """Decrease of the logarithm of the uncertainty per position."""
        return -np.log1p(-np.minimum(values, 1 - 1e-12)) / np.array([len(each) for each in cells])

    def take(self, cells: np.ndarray) -> None:
        """Add these positions to the set."""
        self.known.take(cells, self.known.expected[cells].ravel())

    @property
    def enough(self) -> bool:
        """Never: the steps only become small."""
        return False

    @property
    def total(self) -> float:
        """Relative reduction of the largest standard uncertainty by the whole set."""
        return float(1.0 - np.sqrt(np.max(self.variances()) / np.max(self.first)))
