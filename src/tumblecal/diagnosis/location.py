"""Where an effect acts: everywhere, or in a part of the data alone (a pitch setting, a run, a range of temperature)?

The effect's signal is cut to each part in turn, and the evidence of the set with the cut effect, in place of some of its
members, is compared with that of the explanation acted on, on the linearised chain; the parts share the prior of the whole.
An explanation that is one effect is compared with that effect in each part, every other with each effect of the catalogue,
what no entry describes (generic terms, lack of fit) as well.
"""

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.causes import EffectCause, visibilities
from tumblecal.diagnosis.enlarged import Enlarged
from tumblecal.diagnosis.partial_set import partial_sets
from tumblecal.diagnosis.pool import Pool
from tumblecal.diagnosis.screen import Screened
from tumblecal.diagnosis.set_prior import log_priors_beside
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import LEAST_LOCATED_ODDS, VISIBLE
from tumblecal.estimation.identifiability import RANK_TOLERANCE


# A part has at least this many positions, and leaves as many.
_LEAST_POSITIONS = 3
_MOST_TOLD = 3

Part = tuple[str, Bool[np.ndarray, " positions"]]


class Located(NamedTuple):
    """An effect that acts in a part of the data alone, with other causes `beside` it: `log_odds` of that against the
    explanation acted on."""

    effect: str
    part: str
    positions: int
    log_odds: float
    beside: tuple[str, ...]

    @property
    def words(self) -> str:
        """What acts where."""
        beside = "".join(f" beside {label.replace(':', ' at ')}" for label in self.beside)
        return f"{self.effect} {self.part} alone ({self.positions} positions){beside}"


def located(screened: Screened) -> list[Located]:
    """Effects that, acting in a part of the data alone, are more probable than the explanation acted on, the best part of
    each, at most three; none where nothing was detected or the explanation is about the noise."""
    members, causes = screened.best.members, screened.pool.causes
    sought = screened.detection.detected and bool(members or screened.best.unexplained)
    parts = list(_parts(screened.at)) if sought else []
    if not parts:
        return []
    effects = [cause for cause in causes if isinstance(cause, EffectCause)]
    if len(members) == 1:
        effects = [cause for cause in effects if cause is causes[members[0]]] or effects
    cut = [each for cause in effects for each in _in_parts(screened.at, cause, parts)]
    search, parted = screened.search, Pool(tuple(cause for cause, *_ in cut), screened.pool.dof)
    least = 0.0 if screened.best.unexplained else LEAST_LOCATED_ODDS
    whole = search.posterior_at(members, search.left(members)) if members else screened.log_posterior_of_unexplained
    best: dict[str, Located] = {}
    rests = [rest for size in range(max(1, len(members))) for rest in combinations(members, size)]
    evidence = Enlarged(parted, search.known, partial_sets(search.pool, search.z, rests)).settled()
    for rest, own in zip(rests, evidence, strict=True):
        scores = own + log_priors_beside(screened.pool, rest, parted.log_weights)
        beside = tuple(causes[k].label for k in rest)
        for (_, label, words, count), score in zip(cut, scores.tolist(), strict=True):
            odds = score - whole
            if odds > least and label not in beside and odds > _odds_of(best.get(label)):
                best[label] = Located(label, words, count, odds, beside)
    return sorted(best.values(), key=lambda told: -told.log_odds)[:_MOST_TOLD]


def _odds_of(told: Located | None) -> float:
    return -np.inf if told is None else told.log_odds


def _in_parts(at: Tangent, cause: EffectCause, parts: list[Part]) -> Iterator[tuple[EffectCause, str, str, int]]:
    """An effect cut to each part in which it can be seen, with its own label, the part's words and number of positions."""
    share = cause.log_weight - float(np.log(len(parts)))
    signals = _cut(at, list(cause.slot.columns), np.stack([here for _, here in parts]))
    nominal = at.jacobian[:, : at.model.nominal]
    rounding = RANK_TOLERANCE * float(np.sqrt(np.max(np.sum(nominal**2, axis=0))))
    shown = visibilities(signals, at.basis.T @ signals, [cause.slot] * len(parts), VISIBLE, rounding)
    for (words, here), visible in zip(parts, shown, strict=True):
        if visible.block.shape[1]:
            own = cause._replace(label=f"{cause.label} ({words})", log_weight=share, block=visible.block)
            yield own, cause.label, words, int(np.sum(here))


def _cut(
    at: Tangent, columns: list[int], here: Bool[np.ndarray, "parts positions"]
) -> Float[np.ndarray, "parts rows columns"]:
    """White signals of some columns in each part of the positions alone."""
    count = at.problem.readings.size
    signals = np.repeat(at.jacobian[None, :, columns], len(here), axis=0)
    if at.problem.correlated:
        raw = at.evaluation.jacobian[:, :, None, columns] * here.T[:, None, :, None]
        white = at.problem.rows(raw.reshape(*raw.shape[:2], -1))
        signals[:, :count] = np.moveaxis(white.reshape(count, *raw.shape[2:]), 1, 0)
    else:
        signals[:, :count] *= np.repeat(here, 3, axis=1)[:, :, None]
    return signals


def _parts(at: Tangent) -> Iterator[Part]:
    """Parts of the data with their words: every pitch setting, run and mounting, halves in time, thirds in temperature."""
    where, count = at.problem.where, len(at.problem.readings)
    beta, labels = np.degrees(np.asarray(where.beta)), dict(where.labels)
    every: list[Part] = []
    levels = np.unique(np.round(beta, 6))
    if len(levels) > 1 and not at.model.hand_held:
        every += [(f"at pitch {level:g} deg", np.abs(beta - level) < 1e-5) for level in levels.tolist()]
    for column in ("run", "mount"):
        groups = np.asarray(where.index(column))
        names = [label.partition("=")[2] for label in labels[column]]
        every += [(f"in {column} {name}", groups == number) for number, name in enumerate(names) if len(names) > 1]
    order = np.argsort(np.argsort(where.measuring_order, kind="stable"), kind="stable")
    every += [("in the first half", order < count / 2), ("in the second half", order >= count / 2)]
    if where.temperature_degc is not None:
        degc = np.asarray(where.temperature_degc)
        low, high = np.quantile(degc, [1 / 3, 2 / 3])
        every += [(f"below {low:.1f} degC", degc < low), (f"above {high:.1f} degC", degc > high)]
    for words, here in every:
        if _LEAST_POSITIONS <= np.sum(here) <= count - _LEAST_POSITIONS:
            yield words, here
