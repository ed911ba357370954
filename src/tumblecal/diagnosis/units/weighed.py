"""The errors that units share, searched given the causes of the units and the spreads.

As in one data set: the stacked signals of all units, reduced to the normal equations summed over the units, are a residual
space for `Search`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import EFFECT, Cause
from tumblecal.diagnosis.causes.generic import GENERIC, UNEXPLAINED
from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.causes.visibility import visibilities
from tumblecal.diagnosis.evidence import gain
from tumblecal.diagnosis.priors import (
    EFFECT_TEST_WEIGHT,
    EFFECT_WEIGHT,
    GENERIC_TEST_WEIGHT,
    GENERIC_WEIGHT,
    LEAST_VISIBLE_TERM,
    VISIBLE,
)
from tumblecal.diagnosis.sets.cause_sets import Ranked
from tumblecal.diagnosis.sets.search import Search
from tumblecal.diagnosis.units.spread import Spread, deviation, widened
from tumblecal.diagnosis.units.unit import OwnCauses, Reduced, SharedSignal, Unit


# Directions of the summed normal equations below this share of the largest contain only rounding errors.
_ROUNDING = 1e-11


@dataclass(frozen=True)
class Weighed:
    """The shared errors, searched given the causes of the units and the spreads.

    - `reduced`: every unit, given its causes. `gram`, `towards`: summed over the units, spreads integrated out.
    - `log_evidence`: without shared errors; `search`, `ranked`: of the shared errors.
    """

    own: tuple[OwnCauses, ...]
    spreads: tuple[Spread, ...]
    reduced: tuple[Reduced, ...]
    gram: Float[np.ndarray, "columns columns"]
    towards: Float[np.ndarray, " columns"]
    signals: tuple[SharedSignal, ...]
    log_evidence: float
    search: Search
    ranked: Ranked

    @property
    def top(self) -> float:
        """Log posterior of the best set of shared errors, on a scale common to all hypotheses."""
        return self.log_evidence + self.search.top

    @property
    def without(self) -> float:
        """Log posterior that nothing is shared, on the same scale."""
        return self.log_evidence + self.search.posterior(())

    def coefficients(self, members: Sequence[int]) -> Float[np.ndarray, " columns"]:
        """Least-squares coefficients (scaled) of a set of shared errors and of the spreads' means, zero elsewhere."""
        width = len(self.towards)
        directions = [np.zeros((width, 0))]
        for k in members:
            cause = self.search.pool.causes[k]
            block = np.zeros((width, cause.block.shape[1] if cause.block is not None else 0))
            block[list(self.signals[k].columns)] = cause.directions if cause.directions is not None else 1.0
            directions.append(block)
        for spread in self.spreads:
            if spread.with_mean:
                directions.append(np.eye(width)[:, list(spread.signal.columns)] @ self.mean_directions(spread))
        moved = np.hstack(directions)
        step = np.linalg.pinv(moved.T @ self.gram @ moved, rcond=_ROUNDING, hermitian=True) @ (moved.T @ self.towards)
        return moved @ step

    def mean_directions(self, spread: Spread) -> Float[np.ndarray, "coefficients determined"]:
        """Orthonormal combinations of a spread's mean coefficients that the units determine."""
        columns = list(spread.signal.columns)
        return determined(self.gram[np.ix_(columns, columns)])[0]

    def left(self, units: Sequence[Unit], members: Sequence[int]) -> Iterator[Float[np.ndarray, " nu"]]:
        """Residual of every unit, given a set of shared errors and its share of the spreads."""
        shared = self.coefficients(members)
        for unit, reduced in zip(units, self.reduced, strict=True):
            own = shared.copy()
            for spread in self.spreads:
                own = own + deviation(reduced, spread, own)
            yield unit.z - unit.response @ own


def weigh(
    units: Sequence[Unit], signals: Sequence[SharedSignal], own: Sequence[OwnCauses], spreads: tuple[Spread, ...] = ()
) -> Weighed:
    """Search the shared errors, given the causes of the units and the spreads."""
    width = signals[-1].columns[-1] + 1 if signals else 0
    gram, whole, towards = np.zeros((width, width)), np.zeros((width, width)), np.zeros(width)
    log_evidence, listed = sum(spread.log_prior for spread in spreads), []
    for unit, causes in zip(units, own, strict=True):
        reduced = unit.reduced(causes)
        listed.append(reduced)
        for spread in spreads:
            reduced = widened(reduced, spread)
        log_evidence += reduced.log_evidence
        gram, towards = gram + reduced.gram, towards + reduced.towards
        whole += unit.whole
    left = gram, towards
    for spread in spreads:
        if spread.with_mean:
            columns = list(spread.signal.columns)
            axes, information = determined(left[0][np.ix_(columns, columns)])
            own_part = axes / information @ axes.T
            explained = left[1][columns] @ own_part @ left[1][columns]
            log_evidence += float(gain(np.array(explained), len(information)))
            taken = left[0][:, columns] @ own_part
            left = left[0] - taken @ left[0][columns], left[1] - taken @ left[1][columns]
    pool, chosen, z = _pool(*left, whole, signals)
    search = Search(pool, z, True)
    ranked = search.run() if len(pool.causes) else search.ranked()
    evidence = log_evidence + 0.5 * float(z @ z)
    return Weighed(tuple(own), spreads, tuple(listed), gram, towards, chosen, evidence, search, ranked)


def determined(
    gram: Float[np.ndarray, "coefficients coefficients"],
) -> tuple[Float[np.ndarray, "coefficients determined"], Float[np.ndarray, " determined"]]:
    """The combinations of coefficients of which the nominal parameters leave enough to see, as columns, and the information
    on each."""
    information, axes = np.linalg.eigh(gram)
    seen = information > max(VISIBLE**2 * information[-1], 1e-300)
    return axes[:, seen], information[seen]


def _pool(
    gram: np.ndarray, towards: np.ndarray, whole: np.ndarray, signals: Sequence[SharedSignal]
) -> tuple[Pool, tuple[SharedSignal, ...], np.ndarray]:
    """The errors that all units may share as causes in a residual space of the summed normal equations; their signals
    in the same order; and the residual there."""
    wholes = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    gram, towards, whole = gram / np.outer(wholes, wholes), towards / wholes, whole / np.outer(wholes, wholes)
    values, vectors = np.linalg.eigh(gram) if len(gram) else (np.zeros(0), gram)
    kept = values > _ROUNDING * np.max(values, initial=1e-300)
    rows = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
    z = (vectors[:, kept].T @ towards) / np.sqrt(values[kept])
    sizes = np.sqrt(np.maximum(np.diag(gram), 0.0))
    shown: list[tuple[SharedSignal, np.ndarray, np.ndarray | None]] = []
    for signal in signals:
        columns = list(signal.columns)
        if not signal.of_head or not len(z):
            continue
        if not signal.slot.columns:
            if sizes[columns[0]] > LEAST_VISIBLE_TERM:
                shown.append((signal, rows[:, columns] / sizes[columns], None))
            continue
        own, axes = np.linalg.eigh(whole[np.ix_(columns, columns)])
        root = np.sqrt(np.maximum(own, 0.0))[:, None] * axes.T
        seen = visibilities(root.T[None], rows[:, columns].T[None], VISIBLE, 0.0).of(0, signal.slot)
        if seen.block.shape[1]:
            shown.append((signal, seen.block, seen.directions / wholes[columns][:, None]))
    generic = sum(directions is None for _, _, directions in shown)
    causes: list[Cause] = []
    for signal, block, directions in shown:
        if directions is None:
            share = -float(np.log(generic))
            weights = share + float(np.log(GENERIC_WEIGHT)), share + float(np.log(GENERIC_TEST_WEIGHT))
            causes.append(Cause(GENERIC, UNEXPLAINED, *weights, block, words=signal.words))
        else:
            share = -float(np.log(len(shown) - generic))
            weights = share + float(np.log(EFFECT_WEIGHT)), share + float(np.log(EFFECT_TEST_WEIGHT))
            own = Cause(EFFECT, signal.label, *weights, block, slot=signal.slot, directions=directions)
            causes.append(own)
    return Pool.of(causes, len(z)), tuple(signal for signal, _, _ in shown), z
