"""Lack of fit without a catalogue entry: an error that depends on the attitude or the time, with any curve.

A process (`processes`) has no single coefficients: its evidence is that of a covariance, `I + s^2 K` on the residual space,
averaged over sizes s from 3 to 10000 noise standard deviations (Rasmussen and Williams 2006, chapter 5; Kennedy and O'Hagan
2001 for the discrepancy of a model). The best ones of three fields are also evaluated with one curve for all three
(`one_curve`).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.cause import GENERIC, UNEXPLAINED, Cause
from tumblecal.diagnosis.causes.table import Blocks
from tumblecal.diagnosis.lack_of_fit.components import BySize, Components, mean_over_sizes, of_one_vector
from tumblecal.diagnosis.lack_of_fit.one_curve import OneCurve, best_curve, one_curve
from tumblecal.diagnosis.lack_of_fit.processes import Process, Processes, processes
from tumblecal.diagnosis.lack_of_fit.stacks import Stack, shown, stacked
from tumblecal.diagnosis.priors import FITTED, LACK_OF_FIT_TEST_WEIGHT, LACK_OF_FIT_WEIGHT, NEAR_CURVE
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


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

    @classmethod
    def of(cls, at: Tangent, effects: Blocks) -> "LackOfFit":
        """The processes of which the residuals can show enough, and that are more than one of the effects with these blocks."""
        listed = processes(at)
        stacks = stacked(at, listed)
        return cls(at, listed, stacks, np.flatnonzero(shown(at, listed, stacks, effects)))

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

    @property
    def test_log_weights(self) -> Float[np.ndarray, " processes"]:
        """Logarithms of the weights in the test."""
        return self.log_shares + np.log(LACK_OF_FIT_TEST_WEIGHT)

    def by_size(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "processes sizes draws"]:
        """Log evidence of each process and size, on the scale of `evidence.log_evidence`."""
        if len(z) == 1:
            made = of_one_vector([own.products for own in self.stacks], [own.signals @ z[0] for own in self.stacks])
        else:
            each = [own.components.of_vectors(own.directions.mT @ z.T) for own in self.stacks]
            made = BySize(*(np.concatenate(part) for part in zip(*each, strict=True)))
        chosen = np.argsort(np.concatenate([own.numbers for own in self.stacks]))[self.numbers]
        return BySize(made.explained[chosen], made.half_log_dets[chosen]).log_evidence(z, known)

    def test_log_evidence(
        self, by_size: Float[np.ndarray, "processes sizes draws"]
    ) -> Float[np.ndarray, "draws processes"]:
        """Log evidence of each with its weight in the test, the size averaged over."""
        return mean_over_sizes(by_size).T + self.test_log_weights

    def log_evidence(
        self, by_size: Float[np.ndarray, "processes sizes 1"], z: Float[np.ndarray, " nu"], known: bool
    ) -> float:
        """Log evidence of all together, with their prior weight."""
        curves = [own.log_evidence for own in self._of_one_curve(by_size, z, known).values()]
        scores = np.concatenate([self._averaged(by_size)[:, 0], curves])
        return float(np.logaddexp.reduce(scores, initial=-np.inf) + np.log(LACK_OF_FIT_WEIGHT))

    def cause(self, by_size: Float[np.ndarray, "processes sizes 1"], z: Float[np.ndarray, " nu"], known: bool) -> Cause:
        """The most probable process as a term with a coefficient for each component that is clearly above the noise."""
        scores, curves = self._averaged(by_size)[:, 0], self._of_one_curve(by_size, z, known)
        process = self.listed.process(int(self.numbers[np.argmax(scores)]))
        signals, words, weight = process.signals, process.words, float(np.log(LACK_OF_FIT_WEIGHT))
        best = max(curves, key=lambda row: curves[row].log_evidence, default=None)
        if best is not None and curves[best].log_evidence > np.max(scores):
            process = self.listed.process(int(self.numbers[best]))
            signals, words = process.of_one_curve(curves[best].direction), f"{process.words}, all by one curve"
        rows = self.at.problem.rows(signals)
        projected = self.at.basis[: len(rows)].T @ rows
        products = projected.T @ projected
        components, curve = Components.of(products[None]), best_curve(products, z @ projected, z, known)
        scaled = components.scaled[0, curve.size]
        largest = np.argsort(-scaled)[: int(np.sum(scaled > FITTED)) or 1]
        directions = projected @ components.normalised[0][:, largest]
        terms = tuple((rows @ components.mixed[0][:, largest]).T)
        return Cause(GENERIC, UNEXPLAINED, weight, weight, directions, terms=terms, words=words)

    def _averaged(self, by_size: Float[np.ndarray, "processes sizes draws"]) -> Float[np.ndarray, "processes draws"]:
        """Log evidence with the prior share, the size averaged over."""
        return mean_over_sizes(by_size) + self.log_shares[:, None]

    def _of_one_curve(
        self, by_size: Float[np.ndarray, "processes sizes 1"], z: Float[np.ndarray, " nu"], known: bool
    ) -> dict[int, OneCurve]:
        """The best process of each kind of several fields with one curve for all, if it is not far behind the best of all: by
        its row among `numbers`, with its prior share."""
        scores, kinds = self._averaged(by_size)[:, 0], self.listed.kinds
        several, curves = np.flatnonzero(kinds.width[self.numbers] > 1), dict[int, OneCurve]()
        for kind in np.unique(kinds.kind[self.numbers[several]]).tolist():
            own = several[kinds.kind[self.numbers[several]] == kind]
            row = int(own[np.argmax(scores[own])])
            if scores[row] > scores.max() - NEAR_CURVE:
                stack = next(stack for stack in self.stacks if self.numbers[row] in stack.numbers)
                number = int(np.flatnonzero(stack.numbers == self.numbers[row])[0])
                inner = (stack.signals[number] @ z).reshape(-1, 3)
                products = stack.products[number].reshape(*inner.shape, *inner.shape)
                curve = one_curve(products, inner, int(np.argmax(by_size[row, :, 0])), z, known)
                curves[row] = curve._replace(log_evidence=curve.log_evidence + self.log_shares[row])
        return curves
