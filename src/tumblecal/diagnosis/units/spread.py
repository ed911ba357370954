"""Effects whose amount differs from unit to unit, drawn from the distribution of the batch: random effects.

The coefficients of each unit are normal around a mean (none, or an unknown one) with a spread tau, the same in all
directions in the scales of the model; tau has a log-uniform prior on a grid. Everything follows from each unit's normal
equations: with G and g those of the effect, the evidence of a spread is -1/2 log|1 + tau^2 G| + 1/2 g' (1/tau^2 + G)^-1 g
(conjugate; Lindley and Smith 1972), so that the work is linear in the units.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.evidence import gain
from tumblecal.diagnosis.priors import BATCH_WEIGHT, HEAD_SPREAD_WEIGHT
from tumblecal.diagnosis.units.unit import Reduced, SharedSignal


# Spreads tried, in the noise of one unit's coefficients; a spread below the first is indistinguishable from none.
_SPREADS = (1.5, 3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 300.0, 1000.0)
_SEEN = 1e-9


class Spread(NamedTuple):
    """An effect whose size differs from unit to unit: its scale `tau` (scaled units), whether its mean is free, and the
    logarithm of its prior, including the contribution of other spreads to its evidence."""

    signal: SharedSignal
    tau: float
    with_mean: bool
    log_prior: float


def widened(reduced: Reduced, spread: Spread) -> Reduced:
    """The normal equations of a unit with the coefficients of the effect integrated out, about a mean of zero."""
    columns = list(spread.signal.columns)
    across = reduced.gram[:, columns]
    inside = np.eye(len(columns)) / spread.tau**2 + reduced.gram[np.ix_(columns, columns)]
    taken = np.linalg.solve(inside, np.column_stack([across.T, reduced.towards[columns]]))
    log_det = np.linalg.slogdet(inside * spread.tau**2)[1]
    along = reduced.towards[columns] @ taken[:, -1]
    return Reduced(
        reduced.log_evidence - 0.5 * float(log_det) + 0.5 * float(along),
        reduced.gram - across @ taken[:, :-1],
        reduced.towards - across @ taken[:, -1],
    )


def deviation(reduced: Reduced, spread: Spread, mean: Float[np.ndarray, " columns"]) -> Float[np.ndarray, " columns"]:
    """Posterior mean of the coefficients of a unit (all columns, zero elsewhere) about shared ones `mean`."""
    columns = list(spread.signal.columns)
    inside = np.eye(len(columns)) / spread.tau**2 + reduced.gram[np.ix_(columns, columns)]
    own = np.zeros_like(mean)
    own[columns] = np.linalg.solve(inside, (reduced.towards - reduced.gram @ mean)[columns])
    return own


def likely_spreads(
    reduced: Sequence[Reduced], shared: Float[np.ndarray, " columns"], signals: Sequence[SharedSignal], most: int
) -> list[tuple[float, Spread]]:
    """The effects that a spread over the units explains best, with their log odds against none.

    **Arguments:**

    - `reduced`: every unit, given its causes.
    - `shared`: coefficients that all units share already.
    """
    effects = [signal for signal in signals if signal.slot.columns]
    sensors = sum(not signal.of_head for signal in effects)
    grams = np.stack([unit.gram for unit in reduced])
    towards = np.stack([unit.towards for unit in reduced]) - grams @ shared
    scored = []
    for signal in effects:
        columns = list(signal.columns)
        weight = BATCH_WEIGHT / max(1, sensors)
        if signal.of_head:
            weight = HEAD_SPREAD_WEIGHT / max(1, len(effects) - sensors)
        scored.append(
            _best_spread(grams[:, columns][:, :, columns], towards[:, columns], signal, float(np.log(weight)))
        )
    return sorted((pair for pair in scored if pair is not None), key=lambda pair: -pair[0])[:most]


def _best_spread(
    grams: Float[np.ndarray, "units k k"],
    towards: Float[np.ndarray, "units k"],
    signal: SharedSignal,
    log_weight: float,
) -> tuple[float, Spread] | None:
    values, vectors = np.linalg.eigh(grams)
    values = np.maximum(values, 0.0)
    size = np.sqrt(np.mean(np.max(values, axis=1)))
    if not size > _SEEN or np.sum(np.max(values, axis=1) > _SEEN * size**2) < 2:
        return None
    along = np.einsum("uij,ui->uj", vectors, towards)
    logs, tried = [], []
    for ratio in _SPREADS:
        tau = ratio / size
        shrunk = 1.0 / (1.0 + tau**2 * values)
        around_zero = 0.5 * float(np.sum(np.log(shrunk)) + np.sum(tau**2 * shrunk * along**2))
        information = np.einsum("uij,uj,ukj->ik", vectors, shrunk * values, vectors)
        total = np.einsum("uij,uj->i", vectors, shrunk * along)
        own, axes = np.linalg.eigh(information)
        seen = own > _SEEN * own[-1]
        explained = np.array(np.sum((axes[:, seen].T @ total) ** 2 / own[seen]))
        logs += [around_zero, around_zero + float(gain(explained, int(np.sum(seen))))]
        tried += [(tau, False), (tau, True)]
    best = int(np.argmax(logs))
    together = float(np.logaddexp.reduce(logs)) - float(np.log(len(logs))) + log_weight
    tau, with_mean = tried[best]
    return together, Spread(signal, tau, with_mean, together - logs[best])
