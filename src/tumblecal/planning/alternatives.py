"""Alternatives to the leading explanation, and their rows of old and new positions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.planning.new_rows import Rows


MOST_ALTERNATIVES = 10
# A less probable explanation is no alternative, unless it is in one class with the leader: as long as the data do not separate
# the two, nothing is identified, however improbable it is alone. It then has this probability.
LEAST_PROBABILITY = 0.01


@dataclass(frozen=True)
class Alternative:
    """An explanation that competes with the leading one.

    - `labels`: its causes; empty: nothing beyond the nominal model. `columns`: columns of its effects in the full vector.
    - `odds`: against the leader.
    - `rows`: of data and new positions under it: without its outlier positions, and with its permanent changes.
    """

    labels: tuple[str, ...]
    columns: tuple[int, ...]
    odds: float
    rows: Rows


def columns_of(causes: Sequence[Cause]) -> list[int]:
    """Columns of some causes in the full vector."""
    return [column for cause in causes for column in cause.slot.columns]


def alternatives_of(diagnosis: Diagnosis, rows: Rows) -> list[Alternative]:
    """Alternatives to the leading explanation, most probable first.

    **Arguments:**

    - `rows`: of the data, and of new positions, under the leader.
    """
    screened, members = diagnosis.screened, diagnosis.members
    if not all(cause.named for cause in members):
        return []
    best, leader = screened.best, {cause.label for cause in members if cause.slot.columns}
    each = dict(zip(best.equivalents, best.shares, strict=True))
    listed = [(labels, max(each[labels], LEAST_PROBABILITY)) for labels in best.separable]
    listed += best.less_probable
    listed += [(e.labels, e.class_probability) for e in screened.explanations if e is not best and not e.noise]
    wanted = {label for labels, _ in listed for label in labels} - {UNEXPLAINED}
    by_label: dict[str, list[Cause]] = {}
    for k, label in enumerate(screened.pool.labels):
        if label in wanted:
            by_label.setdefault(label, []).append(screened.pool.causes[k])
    alternatives: list[Alternative] = []
    by_labels: dict[tuple[str, ...], list[Cause]] = {}
    for labels, probability in sorted(listed, key=lambda item: -item[1]):
        # A set that includes the effects of the leader can always produce its signal; an unnamed effect predicts nothing.
        if probability < LEAST_PROBABILITY or leader <= set(labels) or not set(labels) <= set(by_label):
            continue
        causes = [cause for label in labels for cause in by_label[label]]
        odds = probability / max(best.own_probability, 1e-12)
        same = next(
            (k for k, other in enumerate(alternatives) if _identical_at_1_g(causes, by_labels[other.labels])), None
        )
        if same is not None:
            alternatives[same] = replace(alternatives[same], odds=alternatives[same].odds + odds)
            continue
        by_labels[labels] = causes
        alternatives.append(Alternative(labels, tuple(columns_of(causes)), odds, _rows_under(causes, diagnosis, rows)))
    return alternatives[:MOST_ALTERNATIVES]


def _identical_at_1_g(causes: Sequence[Cause], others: Sequence[Cause]) -> bool:
    """Whether two sets of effects differ by effects that are one function at 1 g: no measurement on a head separates them."""
    if not all(cause.slot.columns for cause in (*causes, *others)):
        return False
    first, second = ([cause.slot for cause in a if cause not in b] for a, b in ((causes, others), (others, causes)))
    return one_function_at_1_g(first, second)


def _rows_under(causes: Sequence[Cause], diagnosis: Diagnosis, rows: Rows) -> Rows:
    """Rows under an explanation with these causes. Outlier, exchanged or mislabelled positions do not count; a permanent change
    of an axis applies to every new position."""
    excluded = sorted({position for cause in causes for position in cause.positions})
    old, new = np.zeros((len(rows.old), 0)), np.zeros((*rows.new.shape[:2], 0))
    names = [name.partition("@")[0] for name in diagnosis.model.names]
    for cause in causes:
        if not cause.lasting:
            continue
        # After the change the readings respond to it as to the parameter.
        changed = np.any(np.reshape(cause.terms, (len(cause.terms), -1, 3)), axis=(0, 2))
        shown = np.pad(np.repeat(changed, 3), (0, len(rows.old) - 3 * len(changed)))
        for parameter in cause.lasting:
            columns = [k for k, name in enumerate(names) if name == parameter]
            here = np.where(shown, rows.old[:, columns].sum(axis=1), 0.0)
            old, new = np.column_stack([old, here]), np.dstack([new, rows.new[:, :, columns].sum(axis=2)])
    return rows.with_terms(excluded, old, new)
