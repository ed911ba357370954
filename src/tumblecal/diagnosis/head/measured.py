"""The errors of a head as many units measured them: one exact fit, each unit's own parameters eliminated from it.

Every unit gives its information on what is shared (Schur complement of its own parameters), so the cost is linear in the
units; Gauss-Newton goes on from the shared solution.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag
from scipy.special import gammaincc

from tumblecal.chain.head_file import MeasuredHead
from tumblecal.diagnosis.head.joint import SharedExplanation
from tumblecal.diagnosis.head.unit import SharedSignal, Unit
from tumblecal.diagnosis.head.unit_fit import Information, UnitFit, levels_of


_STEPS = 3
# Pitch errors are the head's where the units' own estimates scatter no more than their noise does: not less probable.
COMMON = 0.01
# What no unit shows of an effect is kept at zero to within this share of its scale.
_KEPT = 1e-3
# Information that is less than this share of the whole is rounding.
_NONE_LEFT = 1e-6


@dataclass(frozen=True)
class HeadFit:
    """The joint fit.

    - `head`: the errors measured; None where nothing is shared.
    - `pitch_p_value`: that the units' pitch errors scatter so much by their noise alone; None where nothing is to compare.
    - `vectors`: every unit's full vector. `own_values`, `own_sd` (units, coefficients): every unit's own estimate of the
      shared coefficients, base units; nan where it shows nothing of one.
    - `moves`: from what was estimated to the head's errors. `parts`: each unit's information on it.
    """

    head: MeasuredHead | None
    pitch_p_value: float | None
    vectors: tuple[Float[np.ndarray, " full"], ...]
    own_values: Float[np.ndarray, "units coefficients"]
    own_sd: Float[np.ndarray, "units coefficients"]
    moves: Float[np.ndarray, "errors unknowns"]
    parts: tuple[Information, ...]

    def without(self, number: int) -> MeasuredHead | None:
        """The head as the other units measured it, so that a unit is not told what it said itself.

        The values are the others'. Their covariance is that of all units times a factor on a coarse scale: units of one
        plan then share what a plan decides.
        """
        if self.head is None or len(self.parts) < 2:
            return None
        whole, own = _sum(self.parts), self.parts[number]
        left = whole.matrix - own.matrix
        seen = np.diag(left) > _NONE_LEFT * np.diag(whole.matrix)
        # A pitch setting of this unit alone, say: the others know nothing of it.
        kept = ~np.any(self.moves[:, ~seen] != 0, axis=1)
        if not np.any(kept):
            return None
        inside = np.ix_(seen, seen)
        values = self.moves[:, seen] @ np.linalg.solve(left[inside], (whole.towards - own.towards)[seen])
        inverse = np.linalg.inv(np.linalg.cholesky(whole.matrix[inside]))
        smallest = float(np.min(np.linalg.eigvalsh(inverse @ left[inside] @ inverse.T)))
        wider = 1.25 ** np.ceil(-np.log(max(smallest, _NONE_LEFT)) / np.log(1.25) - 0.3)
        chosen = np.flatnonzero(kept)
        return replace(
            self.head,
            names=tuple(self.head.names[k] for k in chosen),
            units=tuple(self.head.units[k] for k in chosen),
            values=values[chosen],
            covariance=self.head.covariance[np.ix_(chosen, chosen)] * wider,
        )


def measured_head(units: Sequence[Unit], told: SharedExplanation, sources: Sequence[str]) -> HeadFit:
    """Fit what the units share, by one explanation, beside each unit's own parameters and causes.

    **Arguments:**

    - `sources`: the units' files, for the record.
    """
    weighed, blocks = told.weighed, []
    members = [k for k in told.told.members if weighed.signals[k].slot.columns]
    for k in members:
        directions = weighed.search.pool.causes[k].directions
        assert directions is not None
        blocks.append(np.linalg.qr(directions)[0] * np.array(weighed.signals[k].scales)[:, None])
    signals = [weighed.signals[k] for k in members]
    # The means about which the units' own amounts scatter are estimated too, and are nothing of the head.
    about = [spread for spread in weighed.spreads if spread.with_mean]
    for spread in about:
        blocks.append(weighed.mean_directions(spread) * np.array(spread.signal.scales)[:, None])
    every = [*signals, *(spread.signal for spread in about)]
    moves = np.asarray(block_diag(np.zeros((0, 0)), *blocks))
    levels = sorted(
        {name for unit in units for name in levels_of(unit)}, key=lambda name: float(name.partition("@")[2])
    )
    fits = [
        UnitFit(unit, own, every, moves, weighed.spreads, levels) for unit, own in zip(units, weighed.own, strict=True)
    ]
    shared = np.zeros(moves.shape[1])
    for _ in range(_STEPS):
        for fit in fits:
            fit.linearise(moves @ shared)
        shared = _solved(_sum([fit.without_pitch for fit in fits]))
        for fit in fits:
            fit.step(shared)
    moves = moves[: sum(len(signal.scales) for signal in signals)]
    own = [fit.own_estimate(moves) for fit in fits]
    p_value = _pitch_p_value(fits, shared)
    common = p_value is not None and p_value > COMMON
    parts = tuple(fit.information if common else fit.without_pitch for fit in fits)
    names, bases = [name for signal in signals for name in signal.slot.names], [*_bases(signals)]
    if common:
        names, bases, moves = (
            [*names, *levels],
            [*bases, *["rad"] * len(levels)],
            np.asarray(block_diag(moves, np.eye(len(levels)))),
        )
    head = None
    if names:
        ids = tuple(signal.label for signal in signals)
        values, covariance = moves @ _solved(_sum(parts)), _covariance(parts, moves, signals)
        head = MeasuredHead(ids, tuple(names), tuple(bases), values, covariance, tuple(sources))
    return HeadFit(
        head,
        p_value,
        tuple(fit.vector for fit in fits),
        np.stack([values for values, _ in own]),
        np.stack([sd for _, sd in own]),
        moves,
        parts,
    )


def _covariance(parts: Sequence[Information], moves: np.ndarray, signals: Sequence[SharedSignal]) -> np.ndarray:
    """Of the head's errors; what no unit shows of an effect is kept at zero by a small variance."""
    covariance = moves @ np.linalg.inv(_sum(parts).matrix) @ moves.T
    first = 0
    for signal in signals:
        own = slice(first, first + len(signal.scales))
        left, singular, _ = np.linalg.svd(moves[own] / np.array(signal.scales)[:, None])
        hidden = left[:, int(np.sum(singular > 0.5)) :] * np.array(signal.scales)[:, None]
        covariance[own, own] += _KEPT**2 * hidden @ hidden.T
        first += len(signal.scales)
    return covariance


def _bases(signals: Sequence[SharedSignal]) -> Iterator[str]:
    return (unit for signal in signals for unit in signal.slot.units)


def _sum(parts: Sequence[Information]) -> Information:
    return Information(
        np.sum([part.matrix for part in parts], axis=0), np.sum([part.towards for part in parts], axis=0)
    )


def _solved(part: Information) -> np.ndarray:
    return np.linalg.solve(part.matrix, part.towards)


def _pitch_p_value(fits: Sequence[UnitFit], shared: np.ndarray) -> float | None:
    """That the units' pitch errors are the same: chi-square of their scatter, what is shared taken as found."""
    count = len(shared)
    parts = [
        Information(
            fit.information.matrix[count:, count:],
            fit.information.towards[count:] - fit.information.matrix[count:, :count] @ shared,
        )
        for fit in fits
    ]
    whole = _sum(parts)
    estimated = sum(int(np.sum(np.diag(part.matrix) > 0)) for part in parts)
    if estimated <= len(whole.towards) or len(whole.towards) == 0:
        return None
    mean = _solved(whole)
    chi2 = 0.0
    for part in parts:
        seen = np.diag(part.matrix) > 0
        off = np.linalg.solve(part.matrix[np.ix_(seen, seen)], part.towards[seen]) - mean[seen]
        chi2 += float(off @ part.matrix[np.ix_(seen, seen)] @ off)
    return float(gammaincc((estimated - len(mean)) / 2, chi2 / 2))
