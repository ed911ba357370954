"""Lack of fit without a catalogue entry: an error that depends on the attitude or the time, with any curve.

A process (`processes`) has no single coefficients: its evidence is that of a covariance, `I + s^2 K` on the residual space,
averaged over sizes s from 3 to 10000 noise standard deviations (Rasmussen and Williams 2006, chapter 5; Kennedy and O'Hagan
2001 for the discrepancy of a model). The best ones of three fields are also evaluated with one curve for all three
(`one_curve`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.generic import GENERIC, UNEXPLAINED
from tumblecal.diagnosis.causes.table import Blocks
from tumblecal.diagnosis.lack_of_fit.components import components_of, mean_over_sizes, scales_of
from tumblecal.diagnosis.lack_of_fit.one_curve import best_curve, one_curve
from tumblecal.diagnosis.lack_of_fit.processes import Process, Processes, processes
from tumblecal.diagnosis.lack_of_fit.stacks import Stack, by_size, shown, stacked
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.diagnosis.priors import LACK_OF_FIT_TEST_WEIGHT, LACK_OF_FIT_WEIGHT, NEAR_CURVE
from tumblecal.ground.showing import brief


# Components are fitted from this variance on, in units of the noise's: fitted freely, smaller ones spoil what is predicted.
_FITTED = 9.0


@dataclass(frozen=True)
class LackOfFit:
    """Processes, each of which may be missing in the model.

    - `at`: the problem; `listed`, `stacks`: all processes of it.
    - `numbers`: which of these the residuals can show and are more than an effect.
    """

    __repr__ = brief

    at: Tangent
    listed: Processes
    stacks: tuple[Stack, ...]
    numbers: Int[np.ndarray, " processes"]

    @cached_property
    def visible(self) -> tuple[Process, ...]:
        """The processes that the residuals can show."""
        return tuple(self.listed.process(number) for number in self.numbers.tolist())

    @property
    def words(self) -> tuple[str, ...]:
        """Dependent quantity and variable, in words."""
        return tuple(process.words for process in self.visible)

    @cached_property
    def log_shares(self) -> Float[np.ndarray, " processes"]:
        """Logarithms of the processes' prior shares; each of several fields has its share a second time for one curve."""
        shares = self.listed.share[self.numbers]
        return np.log(shares / np.sum(shares * (1 + (self.listed.kinds.width[self.numbers] > 1))))

    def test_log_evidence(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "draws processes"]:
        """Log evidence of each with its weight in the test, on the scale of `evidence.log_evidence`."""
        return self._log_evidence(self._by_size(z, known)).T + np.log(LACK_OF_FIT_TEST_WEIGHT)

    def log_evidence(self, z: Float[np.ndarray, " nu"], known: bool) -> float:
        """Log evidence of all together, with their prior weight, on the same scale."""
        by_size = self._by_size(z[None], known)
        scores = self._log_evidence(by_size)[:, 0]
        together = self._of_one_curve(by_size, scores, z, known).log_evidence
        return float(
            np.logaddexp.reduce(np.concatenate([scores, together]), initial=-np.inf) + np.log(LACK_OF_FIT_WEIGHT)
        )

    def cause(self, z: Float[np.ndarray, " nu"], known: bool) -> Cause:
        """The most probable process as a term with a coefficient for each component that is clearly above the noise."""
        by_size, weight = self._by_size(z[None], known), float(np.log(LACK_OF_FIT_WEIGHT))
        scores = self._log_evidence(by_size)[:, 0]
        together = self._of_one_curve(by_size, scores, z, known)
        process = self.listed.process(int(self.numbers[np.argmax(scores)]))
        signals, words = process.signals, process.words
        if np.max(together.log_evidence, initial=-np.inf) > np.max(scores):
            best = int(np.argmax(together.log_evidence))
            process = self.listed.process(int(together.numbers[best]))
            signals, words = process.of_one_curve(together.direction[best]), f"{process.words}, all by one curve"
        rows = self.at.problem.rows(signals)
        projected = self.at.basis[: len(rows)].T @ rows
        products = (projected.T @ projected)[None]
        curve, components = best_curve(products, (z @ projected)[None], z, known), components_of(products)
        scaled = scales_of(products)[0, curve.size[0]] * components.variances[0]
        largest = np.argsort(-scaled)[: int(np.sum(scaled > _FITTED)) or 1]
        directions = components.directions(projected[None])[0][:, largest]
        terms = tuple((rows @ components.mixed[0][:, largest]).T)
        return Cause(GENERIC, UNEXPLAINED, weight, weight, directions, terms=terms, words=words)

    def _of_one_curve(
        self,
        by_size: Float[np.ndarray, "processes sizes 1"],
        scores: Float[np.ndarray, " processes"],
        z: Float[np.ndarray, " nu"],
        known: bool,
    ) -> "_Together":
        """The best process of each kind of several fields with one curve for all, where it may matter, with its share.

        **Arguments:**

        - `by_size`, `scores`: log evidence of all processes, size by size, and averaged with their shares.
        """
        kinds, several = self.listed.kinds.kind[self.numbers], self.listed.kinds.width[self.numbers] > 1
        best = [
            max(np.flatnonzero(kinds == kind), key=scores.__getitem__) for kind in np.unique(kinds[several]).tolist()
        ]
        near = [int(row) for row in best if scores[row] > scores.max() - NEAR_CURVE]
        numbers = self.numbers[near]
        if not near:
            return _Together(numbers, np.zeros((0, 0)), np.zeros(0))
        products, inner = self._side_by_side(numbers, z)
        made = one_curve(products, inner, np.argmax(by_size[near, :, 0], axis=1), z, known)
        return _Together(numbers, made.direction, made.log_evidence + self.log_shares[near])

    def _side_by_side(
        self, numbers: Int[np.ndarray, " processes"], z: Float[np.ndarray, " nu"]
    ) -> tuple[Float[np.ndarray, "processes 3 most 3 most"], Float[np.ndarray, "processes 3 most"]]:
        """Products of the signals of processes of three fields with each other and with a residual vector; those of fewer
        signals with zeros."""
        most = int(self.listed.counts[self.listed.kinds.variable[numbers]].max())
        products, inner = np.zeros((len(numbers), 3, most, 3, most)), np.zeros((len(numbers), 3, most))
        for row, number in enumerate(numbers.tolist()):
            stack = next(stack for stack in self.stacks if number in stack.numbers)
            signals = stack.signals[int(np.flatnonzero(stack.numbers == number)[0])]
            count = len(signals) // 3
            own = (signals @ signals.T).reshape(count, 3, count, 3)
            products[row, :, :count, :, :count] = own.transpose(1, 0, 3, 2)
            inner[row, :, :count] = (signals @ z).reshape(count, 3).T
        return products, inner

    def _log_evidence(
        self, by_size: Float[np.ndarray, "processes sizes draws"]
    ) -> Float[np.ndarray, "processes draws"]:
        """Log evidence with the prior share."""
        return mean_over_sizes(by_size) + self.log_shares[:, None]

    def _by_size(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "processes sizes draws"]:
        own = len(z) == 1 and known == self.at.problem.known and np.array_equal(z[0], self.at.z)
        return self._own_by_size if own else self._weighed(z, known)

    @cached_property
    def _own_by_size(self) -> Float[np.ndarray, "processes sizes 1"]:
        """Of the problem's own residual vector, which the test and the posterior ask for."""
        return self._weighed(self.at.z[None], self.at.problem.known)

    def _weighed(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "processes sizes draws"]:
        return by_size(self.stacks, self.numbers, z).log_evidence(z, known)


class _Together(NamedTuple):
    """Processes of one curve, by their numbers among all: the fields' shares, and the log evidence with the prior share."""

    numbers: Int[np.ndarray, " processes"]
    direction: Float[np.ndarray, "processes fields"]
    log_evidence: Float[np.ndarray, " processes"]


def lack_of_fit(at: Tangent, effects: Blocks) -> LackOfFit:
    """The processes of which the residuals can show enough, and that are more than one of the effects with these blocks."""
    listed = processes(at)
    stacks = stacked(at, listed)
    return LackOfFit(at, listed, stacks, np.flatnonzero(shown(at, listed, stacks, effects)))
