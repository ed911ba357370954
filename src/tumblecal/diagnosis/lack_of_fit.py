"""Lack of fit that no entry describes: something that follows the attitude or the time, whatever its curve.

A process (`processes`) has no coefficients to pay for one by one: its evidence is that of a covariance, `I + s^2 K` on the
residual space, averaged over sizes s from 3 to 10000 noise standard deviations (Rasmussen and Williams 2006, chapter 5;
Kennedy and O'Hagan 2001 for the discrepancy of a model). The best ones of three fields are weighed with one curve for all
three as well (`one_curve`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.components import Sizes, components_of, mean_over_sizes, sizes_of
from tumblecal.diagnosis.generic_causes import Generic
from tumblecal.diagnosis.one_curve import OneCurve, one_curve
from tumblecal.diagnosis.processes import Process, processes
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import (
    LACK_OF_FIT_TEST_WEIGHT,
    LACK_OF_FIT_WEIGHT,
    LEAST_VISIBLE_TERM,
    NEAR_CURVE,
    SAME_TERM,
)
from tumblecal.ground.showing import brief


# Components are fitted from this variance on, in units of the noise's: fitted freely, smaller ones spoil what is predicted.
_FITTED = 9.0


@dataclass(frozen=True)
class LackOfFit:
    """Processes of which each may be what the model lacks.

    - `at`: the problem in which the residuals can show them.
    - `directions` (nu, all components), orthonormal within each process; `variances` (processes, most components): of the
      components at size one, 0 where there are fewer.
    """

    __repr__ = brief

    at: Tangent
    visible: tuple[Process, ...]
    directions: Float[np.ndarray, "nu columns"]
    variances: Float[np.ndarray, "processes most"]

    @property
    def words(self) -> tuple[str, ...]:
        """What depends on what."""
        return tuple(process.words for process in self.visible)

    @cached_property
    def log_shares(self) -> Float[np.ndarray, " processes"]:
        """Logarithms of the processes' prior shares; each of several fields has its own once more for one curve."""
        shares = np.array([process.variable.share for process in self.visible])
        twice = np.array([1 + (process.width > 1) for process in self.visible])
        return np.log(shares / np.sum(shares * twice))

    def test_log_evidence(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "draws processes"]:
        """Log evidence of each with its weight in the test, on the scale of `evidence.log_evidence`."""
        return self._log_evidence(z, known) + np.log(LACK_OF_FIT_TEST_WEIGHT)

    def log_evidence(self, z: Float[np.ndarray, " nu"], known: bool) -> float:
        """Log evidence of all together, with their prior weight, on the same scale."""
        scores = self._log_evidence(z[None], known)[0]
        together = [score for _, _, score in self._of_one_curve(scores, z, known)]
        return float(np.logaddexp.reduce([*scores, *together], initial=-np.inf) + np.log(LACK_OF_FIT_WEIGHT))

    def cause(self, z: Float[np.ndarray, " nu"], known: bool) -> Cause:
        """The most probable process as a term with a coefficient for each component that is clearly above the noise."""
        scores, weight = self._log_evidence(z[None], known)[0], float(np.log(LACK_OF_FIT_WEIGHT))
        best, together = int(np.argmax(scores)), self._of_one_curve(scores, z, known)
        number, curve, highest = max(together, key=lambda made: made[2], default=(best, None, -np.inf))
        if curve is not None and highest > scores[best]:
            process, components, scaled = self.visible[number], curve.components, curve.scaled
            signals, words = process.of_one_curve(curve.direction), f"{process.words}, all by one curve"
        else:
            signals, words = self.visible[best].signals, self.words[best]
            components, scaled = components_of(self._projected(signals)), self._scaled_best(best, z, known)
        rows = self.at.problem.rows(signals)
        seen = int(np.sum(scaled > _FITTED)) or 1
        terms = tuple((rows @ components.mixed[:, :seen]).T)
        return Generic(weight, weight, components.directions[:, :seen], terms, words)

    def _of_one_curve(
        self, scores: Float[np.ndarray, " processes"], z: Float[np.ndarray, " nu"], known: bool
    ) -> list[tuple[int, OneCurve, float]]:
        """The best process of each kind of several fields with one curve for all, where it may matter: its number, and its
        log evidence with its share."""
        best: dict[str, int] = {}
        for number, process in enumerate(self.visible):
            kind = process.words.partition(":")[0]
            if process.width > 1 and (kind not in best or scores[number] > scores[best[kind]]):
                best[kind] = number
        near = [number for number in best.values() if scores[number] > np.max(scores) - NEAR_CURVE]
        made = []
        for number in near:
            process = self.visible[number]
            curve = one_curve(self._projected(process.signals), process.width, z, known)
            made.append((number, curve, curve.log_evidence + float(self.log_shares[number])))
        return made

    def _projected(self, signals: Float[np.ndarray, "positions 3 columns"]) -> Float[np.ndarray, "nu columns"]:
        """Signals in the residual space."""
        return _in_residual_space(self.at, self.at.problem.rows(signals))

    @cached_property
    def _sizes(self) -> Sizes:
        return sizes_of(self.variances)

    def _log_evidence(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "draws processes"]:
        """Log evidence with the prior share."""
        if not self.visible:
            return np.zeros((len(z), 0))
        return (mean_over_sizes(self._by_size(z, known)) + self.log_shares[:, None]).T

    def _by_size(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "processes sizes draws"]:
        squares = np.zeros((*self.variances.shape, len(z)))
        squares[self.variances > 0] = (self.directions.T @ z.T) ** 2
        return self._sizes.log_evidence(squares, np.sum(z**2, axis=1), z.shape[1], known)

    def _scaled_best(self, number: int, z: Float[np.ndarray, " nu"], known: bool) -> Float[np.ndarray, " components"]:
        """Variances of a process's components at its best size."""
        size = int(np.argmax(self._by_size(z[None], known)[number, :, 0]))
        return self._sizes.scaled[number, size, : int(np.sum(self.variances[number] > 0))]


def lack_of_fit(at: Tangent, effects: Sequence[Float[np.ndarray, "nu rank"]]) -> LackOfFit:
    """The processes of which the residuals can show enough, and that are more than one of the effects with these blocks."""
    every = list(processes(at))
    signals = [process.signals for process in every]
    of_all = at.problem.rows(np.concatenate(signals, axis=2))
    projected = _in_residual_space(at, of_all)
    first = np.cumsum([0, *(own.shape[2] for own in signals)])
    whole, seen = (np.add.reduceat(np.sum(rows**2, axis=0), first[:-1]) for rows in (of_all, projected))
    shown = seen > np.maximum(LEAST_VISIBLE_TERM**2 * whole, _held(projected, first[:-1], effects) / SAME_TERM**2)
    numbers = np.flatnonzero(shown).tolist()
    made = [components_of(projected[:, first[number] : first[number + 1]]) for number in numbers]
    variances = np.zeros((len(made), max((len(own.variances) for own in made), default=0)))
    for row, own in zip(variances, made, strict=True):
        row[: len(own.variances)] = own.variances
    directions = np.hstack([np.zeros((at.dof, 0)), *(own.directions for own in made)])
    return LackOfFit(at, tuple(every[number] for number in numbers), directions, variances)


def _in_residual_space(at: Tangent, rows: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "nu columns"]:
    return at.basis[: len(rows)].T @ rows


def _held(
    projected: Float[np.ndarray, "nu columns"],
    first: Int[np.ndarray, " processes"],
    effects: Sequence[Float[np.ndarray, "nu rank"]],
) -> Float[np.ndarray, " processes"]:
    """How much of each process's variance one of the effects can make, at most."""
    if not effects:
        return np.zeros(len(first))
    starts = np.cumsum([0, *(block.shape[1] for block in effects[:-1])])
    squares = (np.hstack(effects).T @ projected) ** 2
    return np.max(np.add.reduceat(np.add.reduceat(squares, first, axis=1), starts, axis=0), axis=0)
