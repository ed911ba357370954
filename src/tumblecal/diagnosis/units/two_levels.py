"""Whether an error of the head has two levels in the order of the units: the head was set up again between two of them.

Two levels, the best of all splits, are tested against a spread common to all units by their likelihood ratio; its null
distribution is drawn from that spread, with the best split searched in every draw.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincc

from tumblecal.diagnosis.units.own_amounts import OwnAmounts, own_amounts, spread_likelihoods
from tumblecal.diagnosis.units.unit import SharedSignal, Unit
from tumblecal.diagnosis.units.weighed import Weighed
from tumblecal.effects.effect import of_head


# Two levels are reported from this p-value on, if the units agree with them within the noise (p-value).
_LEVEL, _FITS = 0.01, 0.01
# Of one unit alone nobody knows that the next ones would be like it.
_LEAST_UNITS = 2
_DRAWS = 1000


class TwoLevels(NamedTuple):
    """An error of the head that is another from some unit on.

    - `first`: number of the first unit of the second level. `values`, `sd` (2, coefficients): of each level, scaled.
    - `p_value`: of so clear a split in units that scatter in any order, all errors tried counted.
    """

    signal: SharedSignal
    first: int
    values: Float[np.ndarray, "2 coefficients"]
    sd: Float[np.ndarray, "2 coefficients"]
    p_value: float


def two_levels(units: Sequence[Unit], weighed: Weighed, members: Sequence[int]) -> Iterator[TwoLevels]:
    """The errors of the head (shared, varying, or of some units) that have two levels.

    **Arguments:** as of `own_amounts`.
    """
    tried = list(_tried(units, weighed, members))
    for signal in tried:
        found = _split(own_amounts(units, weighed, members, signal))
        if found is not None and found.p_value * len(tried) < _LEVEL:
            yield found._replace(p_value=min(1.0, found.p_value * len(tried)))


def _tried(units: Sequence[Unit], weighed: Weighed, members: Sequence[int]) -> Iterator[SharedSignal]:
    own = [{unit.pool.labels[k] for k in causes.members} for unit, causes in zip(units, weighed.own, strict=True)]
    shared = {weighed.signals[k].label for k in members}
    shared |= {spread.signal.label for spread in weighed.spreads}
    seen = set[str]()
    for signal in (*weighed.signals, *(spread.signal for spread in weighed.spreads)):
        several = sum(signal.label in labels for labels in own) > 1
        if signal.slot.columns and of_head(signal.slot.links) and signal.label not in seen:
            seen.add(signal.label)
            if several or signal.label in shared:
                yield signal


def _split(amounts: OwnAmounts) -> TwoLevels | None:
    """The best split and its p-value; None where there is no good one."""
    chosen = np.flatnonzero(amounts.seen_by)
    if len(chosen) < 2 * _LEAST_UNITS or not amounts.axes.shape[1]:
        return None
    grams, towards = (whole[chosen] for whole in amounts.along)
    explained = _explained(grams, towards[None])[0]
    split = int(np.argmax(explained))
    values = np.linalg.solve(grams, towards[:, :, None])[:, :, 0]
    left = float(np.vecdot(values, towards).sum() - explained[split])
    if gammaincc((len(chosen) - 2) * grams.shape[1] / 2, left / 2) < _FITS:
        return None
    likelihoods, taus = spread_likelihoods(grams, towards)
    observed = 0.5 * explained[split] - float(np.max(likelihoods[:, 0]))
    drawn = _drawn(grams, float(taus[np.argmax(likelihoods[:, 0])]))
    null = 0.5 * np.max(_explained(grams, drawn), axis=1) - np.max(spread_likelihoods(grams, drawn)[0], axis=0)
    p_value = (1 + int(np.sum(null >= observed))) / (1 + len(null))
    parts = (slice(None, split + _LEAST_UNITS), slice(split + _LEAST_UNITS, None))
    covariances = [np.linalg.inv(grams[part].sum(axis=0)) for part in parts]
    levels = [inverse @ towards[part].sum(axis=0) for inverse, part in zip(covariances, parts, strict=True)]
    axes = amounts.axes
    sds = [np.sqrt(np.einsum("ci,ij,cj->c", axes, inverse, axes)) for inverse in covariances]
    first = int(chosen[split + _LEAST_UNITS])
    return TwoLevels(amounts.signal, first, np.stack(levels) @ axes.T, np.stack(sds), p_value)


def _explained(
    grams: Float[np.ndarray, "units k k"], towards: Float[np.ndarray, "draws units k"]
) -> Float[np.ndarray, "draws splits"]:
    """What two levels explain, by the split."""
    inner = slice(_LEAST_UNITS - 1, len(grams) - _LEAST_UNITS)
    before, sums = np.cumsum(grams, axis=0), np.cumsum(towards, axis=1)
    total = np.zeros((len(towards), 1))
    for part, along in (
        (before[inner], sums[:, inner]),
        (before[-1] - before[inner], sums[:, -1:] - sums[:, inner]),
    ):
        total = total + np.einsum("dsi,sij,dsj->ds", along, np.linalg.inv(part), along)
    return total


def _drawn(grams: Float[np.ndarray, "units k k"], tau: float) -> Float[np.ndarray, "draws units k"]:
    """Normal equations of units whose amounts scatter by a spread."""
    rng = np.random.default_rng(0)
    amounts, noise = (rng.normal(size=(_DRAWS, *grams.shape[:2])) for _ in range(2))
    return tau * np.einsum("uij,duj->dui", grams, amounts) + np.einsum("uij,duj->dui", np.linalg.cholesky(grams), noise)
