"""Location of an effect: everywhere, or in a part of the data only (a pitch setting, a run, a range of temperature).

The effect's signal is cut to each part in turn, and the evidence of the set with the cut effect, in place of some of its
members, is compared with that of the leading explanation, on the linearised chain; the parts share the prior of the whole. An
explanation that is one effect is compared with that effect in each part, every other with each effect of the catalogue,
including explanations without a name (generic terms, lack of fit).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.cause import EFFECT, Cause
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
    members, pool, search = screened.best.members, screened.pool, screened.search
    sought = screened.detection.detected and bool(members or screened.best.unexplained)
    parts = list(_parts(screened.at)) if sought else []
    if not parts:
        return []
    effects = pool.effects
    if len(members) == 1 and members[0] in effects:
        effects = np.array(members)
    cut, part_of = _in_parts(screened.at, pool, effects, parts)
    least = 0.0 if screened.best.unexplained else LEAST_LOCATED_ODDS
    whole = search.posterior_at(members, search.left(members)) if members else screened.log_posterior_of_unexplained
    rests = [rest for size in range(max(1, len(members))) for rest in combinations(members, size)]
    evidence = with_each(cut, search.known, partial_sets(search.pool, search.z, rests))
    prior = SetPriors.of(pool, rows_of(rests)).beside(cut.log_weights) - whole
    odds = evidence + prior
    best: dict[str, Located] = {}
    for row, k in np.argwhere(odds > least).tolist():
        label, others, (words, inside) = (
            cut.labels[k],
            tuple(pool.labels[other] for other in rests[row]),
            parts[part_of[k]],
        )
        if label not in others and (label not in best or odds[row, k] > best[label].log_odds):
            best[label] = Located(label, words, int(np.sum(inside)), float(odds[row, k]), others)
    return sorted(best.values(), key=lambda found: -found.log_odds)[:_MOST_LISTED]


def _in_parts(
    at: Tangent, pool: Pool, effects: Int[np.ndarray, " effects"], parts: list[Part]
) -> tuple[Pool, Int[np.ndarray, " cut"]]:
    """The effects cut to each part in which they can be seen, as causes with their own labels, and the part of each."""
    every = np.stack([inside for _, inside in parts])
    causes = [pool.causes[k] for k in effects.tolist()]
    widths = np.array([len(cause.slot.columns) for cause in causes])
    listed, owners = [], []
    for width in np.unique(widths).tolist():
        of_width = np.flatnonzero(widths == width)
        columns = [column for k in of_width.tolist() for column in causes[k].slot.columns]
        signals = _cut(at, columns, every).mT
        whole, shown = (
            rows.reshape(len(parts), len(of_width), width, -1).swapaxes(0, 1).reshape(-1, width, rows.shape[2])
            for rows in (signals, signals @ at.basis)
        )
        seen = visibilities(whole, shown, VISIBLE, least_signal(at))
        listed.append(seen.rows)
        numbers = (of_width[:, None] * len(parts) + np.arange(len(parts))).ravel()
        owners.append(np.repeat(numbers, seen.shown.sum(axis=1)))
    owner, together = np.concatenate(owners), np.concatenate(listed)
    order = np.argsort(owner, kind="stable")
    shown, owner = np.unique(owner[order], return_inverse=True)
    effect, part = np.divmod(shown, len(parts))
    weights, test_weights = (
        weights[effects[effect]] - np.log(len(parts)) for weights in (pool.log_weights, pool.test_log_weights)
    )
    labels = [causes[k].label for k in effect.tolist()]

    def made(k: int, cause: Cause) -> Cause:
        return cause._replace(directions=causes[effect[k]].directions)

    slots = [causes[k].slot for k in effect.tolist()]
    cut = Pool.of_kind(EFFECT, labels, (weights, test_weights), together[order], owner, made, slots)
    return Pool.joined([cut], at.dof), part


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
    for words, inside in every:
        if _LEAST_POSITIONS <= np.sum(inside) <= count - _LEAST_POSITIONS:
            yield words, inside
