"""Lack of fit without a catalogue entry: an error that depends on the attitude or the time, with any curve.

A process (`processes`) has no single coefficients: its evidence is that of a covariance, `I + s^2 K` on the residual space,
averaged over sizes s from 3 to 10000 noise standard deviations (Rasmussen and Williams 2006, chapter 5; Kennedy and O'Hagan
2001 for the discrepancy of a model). The best ones of three fields are also evaluated with one curve for all three
(`evidence.one_curve`).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.generic import GENERIC, UNEXPLAINED
from tumblecal.diagnosis.causes.table import Blocks
from tumblecal.diagnosis.lack_of_fit.evidence import (
    best_curve,
    by_size,
    log_evidence_by_size,
    mean_over_sizes,
    one_curve,
)
from tumblecal.diagnosis.lack_of_fit.processes import Process, visible_processes
from tumblecal.diagnosis.priors import FITTED, LACK_OF_FIT_TEST_WEIGHT, LACK_OF_FIT_WEIGHT, NEAR_CURVE
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


# Components of less than this share of the largest one's variance are no more than rounding.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class LackOfFit:
    """Processes, each of which may be missing in the model: those that the residuals of a problem can show and that are more
    than an effect, with the logarithms of their prior shares. Each of several fields has its share a second time for one
    curve."""

    __repr__ = brief

    at: Tangent
    visible: list[Process]
    log_shares: Float[np.ndarray, " processes"]

    @classmethod
    def of(cls, at: Tangent, effects: Blocks) -> "LackOfFit":
        """Of a problem, given effects with these blocks."""
        visible = visible_processes(at, effects)
        shares = np.array([process.variable.share for process in visible])
        twice = np.array([1 + (process.width > 1) for process in visible])
        return cls(at, visible, np.log(shares / np.sum(shares * twice)))

    @property
    def test_log_weights(self) -> Float[np.ndarray, " processes"]:
        """Logarithms of the weights in the test."""
        return self.log_shares + np.log(LACK_OF_FIT_TEST_WEIGHT)

    def by_size(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "processes sizes draws"]:
        """Log evidence of each process and size, on the scale of `evidence.log_evidence`."""
        inner = [process.signals @ z.T for process in self.visible]
        return log_evidence_by_size([process.products for process in self.visible], inner, z, known)

    def test_log_evidence(
        self, by_size: Float[np.ndarray, "processes sizes draws"]
    ) -> Float[np.ndarray, "draws processes"]:
        """Log evidence of each with its weight in the test, the size averaged over."""
        return mean_over_sizes(by_size).T + self.test_log_weights

    def log_evidence(
        self, by_size: Float[np.ndarray, "processes sizes 1"], z: Float[np.ndarray, " nu"], known: bool
    ) -> float:
        """Log evidence of all together, with their prior weight."""
        scores = [own for _, _, own in self._scored(by_size, z, known)]
        return float(np.logaddexp.reduce(scores, initial=-np.inf) + np.log(LACK_OF_FIT_WEIGHT))

    def cause(self, by_size: Float[np.ndarray, "processes sizes 1"], z: Float[np.ndarray, " nu"], known: bool) -> Cause:
        """The most probable process as a term with a coefficient for each component that is clearly above the noise."""
        process, direction, _ = max(self._scored(by_size, z, known), key=lambda own: own[2])
        return _as_cause(self.at, process, direction, z, known)

    def _scored(
        self, by_size: Float[np.ndarray, "processes sizes 1"], z: Float[np.ndarray, " nu"], known: bool
    ) -> list[tuple[Process, Float[np.ndarray, " fields"] | None, float]]:
        """Log evidence of each process with its prior share, the size averaged over; and of the best process of each kind of
        several fields with one curve for all, if it is not far behind the best of all, with the fields' shares."""
        scores = (mean_over_sizes(by_size)[:, 0] + self.log_shares).tolist()
        listed, best = [(own, None, score) for own, score in zip(self.visible, scores, strict=True)], dict[str, int]()
        for row, process in enumerate(self.visible):
            if process.width > 1 and scores[row] > scores[best.setdefault(process.kind, row)]:
                best[process.kind] = row
        for row in best.values():
            if scores[row] > max(scores) - NEAR_CURVE:
                process = self.visible[row]
                inner = (process.signals @ z).reshape(-1, process.width)
                products, size = process.products.reshape(*inner.shape, *inner.shape), int(by_size[row, :, 0].argmax())
                direction, log_evidence = one_curve(products, inner, size, z, known)
                listed.append((process, direction, log_evidence + float(self.log_shares[row])))
        return listed


def _as_cause(
    at: Tangent, process: Process, direction: np.ndarray | None, z: Float[np.ndarray, " nu"], known: bool
) -> Cause:
    """A process as a term, as of `LackOfFit.cause`; `direction`: the fields' shares of one curve."""
    words, weight = process.words + ("" if direction is None else ", all by one curve"), np.log(LACK_OF_FIT_WEIGHT)
    rows = at.problem.rows(process.readings(direction))
    projected = at.basis[: len(rows)].T @ rows
    products = projected.T @ projected
    variances, mixed = np.linalg.eigh(products)
    variances = np.where(variances > _ROUNDING * variances[-1], variances, 0.0)
    scaled = by_size(variances)[0][best_curve(products, z @ projected, z, known).size]
    largest = np.argsort(-scaled)[: int(np.sum(scaled > FITTED)) or 1]
    signals = projected @ mixed[:, largest]
    block, terms = signals / np.linalg.norm(signals, axis=0), tuple((rows @ mixed[:, largest]).T)
    return Cause(GENERIC, UNEXPLAINED, float(weight), float(weight), block, terms=terms, words=words)
