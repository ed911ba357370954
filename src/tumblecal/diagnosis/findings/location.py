"""Location of an effect: everywhere, or in a part of the data only (a pitch setting, a run, a range of temperature).

The effect's signal is cut to each part in turn, and the evidence of the set with the cut effect, in place of some of its
members, is compared with that of the leading explanation, on the linearised chain; the parts share the prior of the whole. An
explanation that is one effect is compared with that effect in each part, every other with each effect of the catalogue,
including explanations without a name (generic terms, lack of fit).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.table import Pool
from tumblecal.diagnosis.priors import LEAST_LOCATED_ODDS
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import rows_of
from tumblecal.diagnosis.sets.partial_set import partial_sets, with_each
from tumblecal.diagnosis.sets.prior import SetPriors
from tumblecal.full_model.priors import VISIBLE
from tumblecal.full_model.tangent import Tangent
from tumblecal.full_model.visibility import least_signal, visibilities


# A part has at least this many positions, and leaves as many.
_LEAST_POSITIONS = 3
_MOST_LISTED = 3

Part = tuple[str, Bool[np.ndarray, " positions"]]


@dataclass(frozen=True)
class Located:
    """An effect that acts in a part of the data only, with other causes (`beside`): `log_odds` against the leading
    explanation."""

    effect: str
    part: str
    positions: int
    log_odds: float
    beside: tuple[str, ...]

    @property
    def odds(self) -> float:
        """Odds against the leading explanation; at most 5e8."""
        return math.exp(min(self.log_odds, 20.0))

    @property
    def words(self) -> str:
        """Effect and part, in words."""
        others = "".join(f" with {label.replace(':', ' at ')}" for label in self.beside)
        return f"{self.effect} {self.part} alone ({self.positions} positions){others}"


def located(screened: Screened) -> list[Located]:
    """Effects that, acting in a part of the data alone, are more probable than the explanation acted on, the best part of
    each, at most three; none where nothing was detected or the explanation is about the noise."""
    members, pool, search, best = screened.best.members, screened.pool, screened.search, screened.best
    sought = screened.detection.detected and bool(members or best.unexplained)
    effects = list(members) if len(members) == 1 and members[0] in pool.effects else pool.effects.tolist()
    listed = _in_parts(screened.at, [pool.causes[k] for k in effects]) if sought else []
    if not listed:
        return []
    cut = Pool.of([cause for cause, *_ in listed], pool.dof)
    least = 0.0 if best.unexplained else LEAST_LOCATED_ODDS
    whole = search.posterior_at(members, search.left(members)) if members else screened.log_posterior_of_unexplained
    rests = [rest for size in range(max(1, len(members))) for rest in combinations(members, size)]
    evidence = with_each(cut, search.known, partial_sets(search.pool, search.z, rests))
    prior = SetPriors.of(pool, rows_of(rests)).beside(cut.log_weights) - whole
    odds = evidence + prior
    found: dict[str, Located] = {}
    for row, k in np.argwhere(odds > least).tolist():
        (cause, words, count), others = listed[k], tuple(pool.labels[other] for other in rests[row])
        label, log_odds = cause.label, float(odds[row, k])
        if label not in others and (label not in found or log_odds > found[label].log_odds):
            found[label] = Located(label, words, count, log_odds, others)
    return sorted(found.values(), key=lambda one: -one.log_odds)[:_MOST_LISTED]


def _in_parts(at: Tangent, effects: Sequence[Cause]) -> list[tuple[Cause, str, int]]:
    """The effects cut to each part in which they can be seen, as causes with their own labels; words and number of positions of
    the part. The parts share the prior of the whole."""
    parts, listed, least = list(_parts(at)), list[tuple[Cause, str, int]](), least_signal(at)
    if not parts:
        return []
    every, share = np.stack([inside for _, inside in parts]), np.log(len(parts))
    for cause in effects:
        signals = _cut(at, list(cause.slot.columns), every).mT
        seen = visibilities(signals, signals @ at.basis, VISIBLE, least)
        part = cause._replace(log_weight=cause.log_weight - share, log_test_weight=cause.log_test_weight - share)
        for number, (words, inside) in enumerate(parts):
            block = seen.of(number, cause.slot).block
            if block.shape[1]:
                listed.append((part._replace(block=block), words, int(np.sum(inside))))
    return listed


def _cut(
    at: Tangent, columns: list[int], inside: Bool[np.ndarray, "parts positions"]
) -> Float[np.ndarray, "parts rows columns"]:
    """White signals of some columns in each part of the positions alone."""
    count = at.problem.readings.size
    signals = np.repeat(at.jacobian[None, :, columns], len(inside), axis=0)
    if at.problem.correlated:
        raw = at.evaluation.jacobian[:, :, None, columns] * inside.T[:, None, :, None]
        white = at.problem.rows(raw.reshape(*raw.shape[:2], -1))
        signals[:, :count] = np.moveaxis(white.reshape(count, *raw.shape[2:]), 1, 0)
    else:
        signals[:, :count] *= np.repeat(inside, 3, axis=1)[:, :, None]
    return signals


def _parts(at: Tangent) -> Iterator[Part]:
    """Parts of the data with their words: every pitch setting, run and mounting, halves in time, thirds in temperature."""
    where, count = at.problem.where, len(at.problem.readings)
    beta, labels = np.degrees(where.pitch_angle), dict(where.labels)
    every: list[Part] = []
    for level in np.unique(np.round(beta, 6)).tolist() if not at.model.hand_held else ():
        every.append((f"at pitch {level:g} deg", np.abs(beta - level) < 1e-5))
    for column in ("run", "mount"):
        groups = np.asarray(where.index(column))
        names = [label.partition("=")[2] for label in labels[column]]
        every += [(f"in {column} {name}", groups == number) for number, name in enumerate(names)]
    order = np.argsort(np.argsort(where.measuring_order, kind="stable"), kind="stable")
    every += [("in the first half", order < count / 2), ("in the second half", order >= count / 2)]
    if where.temperature_degc is not None:
        degc = np.asarray(where.temperature_degc)
        low, high = np.quantile(degc, [1 / 3, 2 / 3])
        every += [(f"below {low:.1f} degC", degc < low), (f"above {high:.1f} degC", degc > high)]
    for words, inside in every:
        # A part of all positions is none.
        if _LEAST_POSITIONS <= np.sum(inside) <= count - _LEAST_POSITIONS:
            yield words, inside
