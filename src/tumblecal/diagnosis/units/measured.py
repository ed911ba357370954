"""The errors of a head as measured by many units: one exact fit, with the parameters of each unit eliminated.

Every unit gives its information on the shared errors (Schur complement of its parameters), so the cost is linear in the units.
Gauss-Newton continues from the shared solution.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from tumblecal.chain.head_file import PITCH, MeasuredHead
from tumblecal.diagnosis.units.joint import SharedExplanation
from tumblecal.diagnosis.units.pitch import PitchSettings, pitch_settings
from tumblecal.diagnosis.units.set_aside import most_aside, not_of_the_head
from tumblecal.diagnosis.units.unit import SharedSignal, Unit
from tumblecal.diagnosis.units.unit_fit import Information, UnitFit, levels_of


_STEPS = 3
# What no unit shows of an effect is kept at zero to within this share of its scale.
_KEPT = 1e-3
# Information that is less than this share of the whole is rounding.
_NONE_LEFT = 1e-6


@dataclass(frozen=True)
class HeadFit:
    """The joint fit.

    - `head`: the measured errors; None if no error is shared.
    - `pitch`: whether the errors of the pitch settings belong to the head; its `alone` by the units' numbers.
    - `vectors`: full vector of every unit. `own_values`, `own_sd` (units, coefficients): separate estimate of the shared
      coefficients by every unit, base units; nan if it does not determine one.
    - `moves`: from the estimated values to the errors of the head. `parts`: information of each unit on them. `aside`: numbers
      of the excluded units.
    """

    head: MeasuredHead | None
    pitch: PitchSettings
    vectors: tuple[Float[np.ndarray, " full"], ...]
    own_values: Float[np.ndarray, "units coefficients"]
    own_sd: Float[np.ndarray, "units coefficients"]
    moves: Float[np.ndarray, "errors unknowns"]
    parts: tuple[Information, ...]
    aside: frozenset[int]

    @property
    def whole(self) -> Information:
        """The information of all units that count."""
        return _sum([part for number, part in enumerate(self.parts) if number not in self.aside])

    def without(self, number: int) -> MeasuredHead | None:
        """The head as measured by the other units, so that the prior of a unit does not contain its own data.

        The values are the others'. Their covariance is that of all units times a factor on a coarse scale: units of one plan
        then share quantities that the plan determines.
        """
        if self.head is None or len(self.parts) - len(self.aside) < 2:
            return None
        whole, own = self.whole, self.parts[number]
        left = whole.matrix - own.matrix
        seen = np.diag(left) > _NONE_LEFT * np.diag(whole.matrix)
        # A pitch setting of this unit alone, say: the others know nothing of it.
        kept = ~np.any(self.moves[:, ~seen] != 0, axis=1)
        if number in self.pitch.alone:
            kept &= [not name.startswith(PITCH) for name in self.head.names]
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


def measured_head(
    units: Sequence[Unit], told: SharedExplanation, sources: Sequence[str], aside: frozenset[int] = frozenset()
) -> HeadFit:
    """Fit the shared errors of one explanation, with the parameters and causes of each unit.

    **Arguments:**

    - `sources`: the units' files, for the record.
    - `aside`: numbers of the excluded units; their separate estimates are reported nevertheless.
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
    counted = [number for number in range(len(units)) if number not in aside]
    levels = sorted(
        {name for number in counted for name in levels_of(units[number])},
        key=lambda name: float(name.partition("@")[2]),
    )
    fits = []
    for number, (unit, own) in enumerate(zip(units, weighed.own, strict=True)):
        seen, settings = (not_of_the_head(unit, own), levels_of(unit)) if number in aside else (own, levels)
        fits.append(UnitFit(unit, seen, every, moves, weighed.spreads, settings))
    shared = np.zeros(moves.shape[1])
    for _ in range(_STEPS):
        for fit in fits:
            fit.linearise(moves @ shared)
        shared = _solved(_sum([fits[number].without_pitch for number in counted]))
        for fit in fits:
            fit.step(shared)
    moves = moves[: sum(len(signal.scales) for signal in signals)]
    own = [fit.own_estimate(moves) for fit in fits]
    pitch = pitch_settings([fits[k] for k in counted], shared, most_aside(len(units)) - len(aside))
    changed = counted[pitch.changed] if pitch.changed is not None else None
    pitch = pitch._replace(alone=tuple(counted[k] for k in pitch.alone), changed=changed)
    settings = np.flatnonzero(pitch.seen).tolist() if pitch.common else []
    kept = [*range(len(shared)), *(len(shared) + k for k in settings)]
    parts = tuple(
        _padded(fit.without_pitch, len(kept))
        if not pitch.common or number in (*pitch.alone, *aside)
        else Information(fit.information.matrix[np.ix_(kept, kept)], fit.information.towards[kept])
        for number, fit in enumerate(fits)
    )
    names = [*(name for signal in signals for name in signal.slot.names), *(levels[k] for k in settings)]
    bases = [*_bases(signals), *["rad"] * len(settings)]
    moves = np.asarray(block_diag(moves, np.eye(len(settings))))
    head = None
    if names:
        ids = tuple(signal.label for signal in signals)
        of_head = [parts[number] for number in counted]
        values, covariance = moves @ _solved(_sum(of_head)), _covariance(of_head, moves, signals)
        made_of = tuple(sources[number] for number in counted)
        head = MeasuredHead(ids, tuple(names), tuple(bases), values, covariance, made_of)
    return HeadFit(
        head,
        pitch,
        tuple(fit.vector for fit in fits),
        np.stack([values for values, _ in own]),
        np.stack([sd for _, sd in own]),
        moves,
        parts,
        aside,
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


def _padded(part: Information, count: int) -> Information:
    """The same among more unknowns, of which nothing is known."""
    more = count - len(part.towards)
    return Information(np.pad(part.matrix, ((0, more), (0, more))), np.pad(part.towards, (0, more)))


def _solved(part: Information) -> np.ndarray:
    return np.linalg.solve(part.matrix, part.towards)
