"""The linear posterior of an explanation, its predictions of new readings, and what these add.

A position adds its rows to an information matrix, so the value of every proposal given those already chosen costs a few small
products.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.plan.information import Information, covariance_of


class Prediction(NamedTuple):
    """Mean and covariance of the readings of each proposal, in units of the noise."""

    mean: Float[np.ndarray, "proposals rows"]
    spread: Float[np.ndarray, "proposals rows rows"]


@dataclass(frozen=True)
class Posterior(Information):
    """Linear posterior of some coefficients: `towards` is the projection of the data, `expected` (cells, 3) the readings of new
    cells without these coefficients."""

    towards: Float[np.ndarray, " all"]
    expected: Float[np.ndarray, "cells 3"]

    @cached_property
    def covariance(self) -> Float[np.ndarray, "all all"]:
        """Covariance of the coefficients."""
        return covariance_of(self.information)

    def predicted(self, cells: Int[np.ndarray, "proposals cells"]) -> Prediction:
        """The readings at each proposal's cells."""
        rows = self.rows(cells)
        mean = self.expected[cells].reshape(len(cells), -1) + rows @ (self.covariance @ self.towards)
        return Prediction(mean, rows @ self.covariance @ rows.swapaxes(1, 2) + np.eye(rows.shape[1]))

    def after(self, cells: Int[np.ndarray, " cells"], readings: Float[np.ndarray, " rows"]) -> "Posterior":
        """With these readings of some cells."""
        towards = self.towards + self.rows(cells).T @ (readings - self.expected[cells].ravel())
        return replace(self, information=self.information_with(cells), towards=towards)


Gains = Callable[[Sequence[Posterior], Int[np.ndarray, "proposals cells"]], Float[np.ndarray, "parts proposals"]]


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
