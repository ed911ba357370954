"""Lack of fit that no entry describes: something that follows the attitude or the time, whatever its curve.

A process (`processes`) has no coefficients to pay for one by one: its evidence is that of a covariance, `I + s^2 K` on the
residual space, averaged over sizes s from 3 to 10000 noise standard deviations (Rasmussen and Williams 2006, chapter 5;
Kennedy and O'Hagan 2001 for the discrepancy of a model). The best ones of three fields are weighed with one curve for all
three as well (`one_curve`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.components import Components, Sizes, components_of, mean_over_sizes, sizes_of
from tumblecal.diagnosis.generic_causes import Generic
from tumblecal.diagnosis.one_curve import OneCurve, one_curve
from tumblecal.diagnosis.processes import processes
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


class Visible(NamedTuple):
    """What the residuals can show of a process: white rows of its signals, their part in the residual space, and its
    components there; `fields` it is of, and its prior share beside others."""

    words: str
    share: float
    fields: int
    rows: Float[np.ndarray, "rows columns"]
    projected: Float[np.ndarray, "nu columns"]
    components: Components

    def of_one_curve(self, direction: Float[np.ndarray, " fields"]) -> Float[np.ndarray, "rows signals"]:
        """White rows of the signals whose fields have these shares."""
        return np.tensordot(self.rows.reshape(len(self.rows), self.fields, -1), direction, (1, 0))


@dataclass(frozen=True)
class LackOfFit:
    """Processes of which each may be what the model lacks.

    - `directions` (nu, all components), orthonormal within each process; `variances` (processes, most components): of the
      components at size one, 0 where there are fewer.
    """

    __repr__ = brief

    visible: tuple[Visible, ...]
    directions: Float[np.ndarray, "nu columns"]
    variances: Float[np.ndarray, "processes most"]

    @property
    def words(self) -> tuple[str, ...]:
        """What depends on what."""
        return tuple(process.words for process in self.visible)

    @cached_property
    def log_shares(self) -> Float[np.ndarray, " processes"]:
        """Logarithms of the processes' prior shares; each of several fields has its own once more for one curve."""
        shares = np.array([process.share for process in self.visible])
        twice = np.array([1 + (process.fields > 1) for process in self.visible])
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
            rows, words = process.of_one_curve(curve.direction), f"{process.words}, all by one curve"
        else:
            process, components = self.visible[best], self.visible[best].components
            rows, words, scaled = process.rows, process.words, self._scaled_best(best, z, known)
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
            if process.fields > 1 and (kind not in best or scores[number] > scores[best[kind]]):
                best[kind] = number
        near = [number for number in best.values() if scores[number] > np.max(scores) - NEAR_CURVE]
        made = [
            (number, one_curve(self.visible[number].projected, self.visible[number].fields, z, known))
            for number in near
        ]
        return [(number, curve, curve.log_evidence + float(self.log_shares[number])) for number, curve in made]

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
        return self._sizes.scaled[number, size, : len(self.visible[number].components.variances)]


def lack_of_fit(at: Tangent, effects: Sequence[Cause]) -> LackOfFit:
    """The processes of which the residuals can show enough, and that are more than one of the effects."""
    every = list(processes(at))
    signals = [process.signals for process in every]
    of_all = at.problem.rows(np.concatenate(signals, axis=2))
    projected = at.basis[: len(of_all)].T @ of_all
    first = np.cumsum([0, *(own.shape[2] for own in signals)])
    whole, seen = (np.add.reduceat(np.sum(rows**2, axis=0), first[:-1]) for rows in (of_all, projected))
    shown = seen > np.maximum(LEAST_VISIBLE_TERM**2 * whole, _held(projected, first[:-1], effects) / SAME_TERM**2)
    visible = []
    for number in np.flatnonzero(shown).tolist():
        process, own = every[number], slice(first[number], first[number + 1])
        about = process.words, process.variable.share, process.fields.shape[2]
        visible.append(Visible(*about, of_all[:, own], projected[:, own], components_of(projected[:, own])))
    variances = np.zeros((len(visible), max((len(process.components.variances) for process in visible), default=0)))
    for number, process in enumerate(visible):
        variances[number, : len(process.components.variances)] = process.components.variances
    directions = np.hstack([np.zeros((at.dof, 0)), *(process.components.directions for process in visible)])
    return LackOfFit(tuple(visible), directions, variances)


def _held(
    projected: Float[np.ndarray, "nu columns"], first: Int[np.ndarray, " processes"], effects: Sequence[Cause]
) -> Float[np.ndarray, " processes"]:
    """How much of each process's variance one of the effects can make, at most."""
    blocks = [cause.block for cause in effects if cause.block is not None]
    if not blocks:
        return np.zeros(len(first))
    starts = np.cumsum([0, *(block.shape[1] for block in blocks[:-1])])
    squares = (np.hstack(blocks).T @ projected) ** 2
    return np.max(np.add.reduceat(np.add.reduceat(squares, first, axis=1), starts, axis=0), axis=0)
