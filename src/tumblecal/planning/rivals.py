"""Rivals of what was named: the explanations that are still possible, and what each can make of old and new positions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.planning.new_rows import Rows


MOST_RIVALS = 10
# An explanation less probable than this is no rival, unless it is one class with the leader: while these data cannot tell the
# two apart nothing is identified, however improbable it is by itself. It counts with these odds then.
LEAST_PROBABILITY = 0.01


@dataclass(frozen=True)
class Rival:
    """An explanation that is still possible.

    - `labels`: its causes; empty: nothing beyond the nominal model. `columns`: the full vector's columns of its effects.
    - `odds`: of it against the leader.
    - `rows`: of data and new positions as it has them: without the positions that it takes for off, and with what it says
      has changed for good.
    """

    labels: tuple[str, ...]
    columns: tuple[int, ...]
    odds: float
    rows: Rows


def columns_of(causes: Sequence[Cause]) -> list[int]:
    """The full vector's columns of some causes."""
    return [column for cause in causes for column in cause.slot.columns]


def rivals_of(diagnosis: Diagnosis, rows: Rows) -> list[Rival]:
    """Explanations that are still possible beside the leading one, most likely first.

    **Arguments:**

    - `rows`: of the data, and of new positions, as the leader has them.
    """
    screened, members = diagnosis.screened, diagnosis.members
    if not all(cause.named for cause in members):
        return []
    best, leader = screened.best, {cause.label for cause in members if cause.slot.columns}
    each = dict(zip(best.equivalents, best.shares, strict=True))
    listed = [(labels, max(each[labels], LEAST_PROBABILITY)) for labels in best.separable]
    listed += best.less_probable
    listed += [
        (told.labels, told.class_probability) for told in screened.explanations if told is not best and not told.noise
    ]
    wanted = {label for labels, _ in listed for label in labels} - {UNEXPLAINED}
    by_label: dict[str, list[Cause]] = {}
    for k, label in enumerate(screened.pool.labels):
        if label in wanted:
            by_label.setdefault(label, []).append(screened.pool.causes[k])
    rivals: list[Rival] = []
    by_labels: dict[tuple[str, ...], list[Cause]] = {}
    for labels, probability in sorted(listed, key=lambda item: -item[1]):
        # A set that holds the leader's effects can always make its signal; what no entry describes predicts nothing.
        if probability < LEAST_PROBABILITY or leader <= set(labels) or not set(labels) <= set(by_label):
            continue
        causes = [cause for label in labels for cause in by_label[label]]
        odds = probability / max(best.own_probability, 1e-12)
        same = next((k for k, other in enumerate(rivals) if _one_function(causes, by_labels[other.labels])), None)
        if same is not None:
            rivals[same] = replace(rivals[same], odds=rivals[same].odds + odds)
            continue
        by_labels[labels] = causes
        rivals.append(Rival(labels, tuple(columns_of(causes)), odds, _seen_by(causes, diagnosis, rows)))
    return rivals[:MOST_RIVALS]


def _one_function(causes: Sequence[Cause], others: Sequence[Cause]) -> bool:
    """Whether two sets of effects differ by effects that are one function at 1 g: no measurement on a head separates them."""
    if not all(cause.slot.columns for cause in (*causes, *others)):
        return False
    own, other = ([cause.slot for cause in a if cause not in b] for a, b in ((causes, others), (others, causes)))
    return one_function_at_1_g(own, other)


def _seen_by(causes: Sequence[Cause], diagnosis: Diagnosis, rows: Rows) -> Rows:
    """Rows as an explanation with these causes has them. Positions that are off, exchanged or mislabelled tell it nothing; what
    changed for good, at whatever axis, is so at every new position."""
    left_out = sorted({position for cause in causes for position in cause.positions})
    old, new = np.zeros((len(rows.old), 0)), np.zeros((*rows.new.shape[:2], 0))
    names = [name.partition("@")[0] for name in diagnosis.model.names]
    for cause in causes:
        if not cause.lasting:
            continue
        # Where it has changed, the readings follow it as they do the parameter.
        changed = np.any(np.reshape(cause.terms, (len(cause.terms), -1, 3)), axis=(0, 2))
        shown = np.pad(np.repeat(changed, 3), (0, len(rows.old) - 3 * len(changed)))
        for parameter in cause.lasting:
            columns = [k for k, name in enumerate(names) if name == parameter]
            here = np.where(shown, rows.old[:, columns].sum(axis=1), 0.0)
            old, new = np.column_stack([old, here]), np.dstack([new, rows.new[:, :, columns].sum(axis=2)])
    return rows.beside(left_out, old, new)
