"""The linear posterior of an explanation, its predictions of new readings, and the information that these add.

A position adds its rows to an information matrix, so the value of every proposal given those already chosen costs a few small
products.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int


# Separated: the odds of the alternatives together are expected to fall by e^20, so that they almost always fall by e^4, also
# against sets of causes that are not listed.
DECIDED = 20.0


class Prediction(NamedTuple):
    """Mean and covariance of the readings of each proposal, in units of the noise."""

    mean: Float[np.ndarray, "proposals rows"]
    spread: Float[np.ndarray, "proposals rows rows"]


@dataclass(frozen=True)
class Posterior:
    """Linear posterior of some coefficients: information matrix and projection of the data; rows of the new cells and their
    readings without these coefficients."""

    information: Float[np.ndarray, "columns columns"]
    towards: Float[np.ndarray, " columns"]
    new: Float[np.ndarray, "cells 3 columns"]
    expected: Float[np.ndarray, "cells 3"]

    @cached_property
    def covariance(self) -> Float[np.ndarray, "columns columns"]:
        """Covariance of the coefficients."""
        return np.linalg.inv(self.information)

    def rows(self, cells: Int[np.ndarray, "proposals cells"]) -> Float[np.ndarray, "proposals rows columns"]:
        """Rows of each proposal's cells."""
        return self.new[cells].reshape(len(cells), -1, len(self.towards))

    def predicted(self, cells: Int[np.ndarray, "proposals cells"]) -> Prediction:
        """The readings at each proposal's cells."""
        rows = self.rows(cells)
        mean = self.expected[cells].reshape(len(cells), -1) + rows @ (self.covariance @ self.towards)
        return Prediction(mean, rows @ self.covariance @ rows.transpose(0, 2, 1) + np.eye(rows.shape[1]))

    def after(self, cells: np.ndarray, readings: Float[np.ndarray, " rows"]) -> "Posterior":
        """With these readings of some cells."""
        (rows,) = self.rows(cells[None])
        towards = self.towards + rows.T @ (readings - self.expected[cells].ravel())
        return replace(self, information=self.information + rows.T @ rows, towards=towards)


Gains = Callable[[Sequence[Posterior], Int[np.ndarray, "proposals cells"]], Float[np.ndarray, "parts proposals"]]


class Value:
    """What proposals add to a set, in natural logarithms.

    **Arguments:**

    - `posteriors`: of the explanations, the leading one first.
    - `gains`: of each proposal, in as many parts as there are `log_odds`.
    - `log_odds`: of each part: the value is the decrease of the logarithm of the sum of all odds.
    - `needed`: the value of a complete set, also if one of its positions turns out to be an outlier.
    """

    def __init__(
        self, posteriors: Sequence[Posterior], gains: Gains, log_odds: np.ndarray, needed: float = DECIDED
    ) -> None:
        self.posteriors, self._gains_of, self.log_odds = posteriors, gains, log_odds
        self._gained, self.lacking, self._needed, self._most = np.zeros(len(log_odds)), needed, needed, 0.0

    def of(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, " proposals"]:
        """The value that each proposal adds."""
        return self._total(self._gained[:, None] + self._gains(cells)) - self.total

    @property
    def total(self) -> float:
        """The value of the set."""
        return float(self._total(self._gained[:, None])[0])

    def take(self, cells: np.ndarray) -> float:
        """Add a proposal to the set, with the readings that the leading explanation predicts; the value that it adds.

        `lacking` is then what the set lacks without the position that adds most.
        """
        before = self.total
        self._gained = self._gained + self._gains([cells])[:, 0]
        expected = self.posteriors[0].predicted(cells[None]).mean[0]
        self.posteriors = [known.after(cells, expected) for known in self.posteriors]
        added = self.total - before
        self._most = max(self._most, added / len(cells))
        self.lacking = max(self._needed - self.total + self._most, 0.0)
        return added

    def _total(self, gains: Float[np.ndarray, "parts proposals"]) -> Float[np.ndarray, " proposals"]:
        return np.logaddexp.reduce(self.log_odds) - np.logaddexp.reduce(self.log_odds[:, None] - gains, axis=0)

    def _gains(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, "parts proposals"]:
        gains, counts = np.zeros((len(self.log_odds), len(cells))), np.array([len(each) for each in cells])
        for count in np.unique(counts):
            numbers = np.flatnonzero(counts == count)
            gains[:, numbers] = self._gains_of(self.posteriors, np.stack([cells[k] for k in numbers.tolist()]))
        return gains


def separations(
    posteriors: Sequence[Posterior], cells: Int[np.ndarray, "proposals cells"]
) -> Float[np.ndarray, "alternatives proposals"]:
    """Expected log Bayes factor between the leading explanation and each alternative.

    Each predicts new readings as a normal distribution, by its fit to the data with the uncertainty of all its coefficients.
    The expected log Bayes factor is the smaller Kullback-Leibler divergence between the two: either may be true.
    """
    leader, *others = (known.predicted(cells) for known in posteriors)
    each = [np.minimum(_divergence(leader, other), _divergence(other, leader)) for other in others]
    return np.maximum(each, 0.0)


def sharpenings(watched: Sequence[int]) -> Gains:
    """Decrease of the logarithm of the largest standard uncertainty among some coefficients; one part."""

    def gains(
        posteriors: Sequence[Posterior], cells: Int[np.ndarray, "proposals cells"]
    ) -> Float[np.ndarray, "1 proposals"]:
        covariance = posteriors[0].covariance
        across, before = posteriors[0].rows(cells) @ covariance[:, watched], np.diag(covariance)[watched]
        less = np.sum(across * np.linalg.solve(posteriors[0].predicted(cells).spread, across), axis=1)
        share = np.max(before - less, axis=1) / np.max(before)
        return -0.5 * np.log(np.maximum(share, 1e-24))[None]

    return gains


def _divergence(one: Prediction, other: Prediction) -> Float[np.ndarray, " proposals"]:
    """Kullback-Leibler divergence of another normal distribution from one."""
    rest = (one.mean - other.mean)[:, :, None]
    solved = np.linalg.solve(other.spread, np.concatenate([one.spread, rest], axis=2))
    traces = np.trace(solved[:, :, :-1], axis1=1, axis2=2) - rest.shape[1]
    squares = np.sum(rest[:, :, 0] * solved[:, :, -1], axis=1)
    return 0.5 * (traces + squares + np.linalg.slogdet(other.spread)[1] - np.linalg.slogdet(one.spread)[1])
