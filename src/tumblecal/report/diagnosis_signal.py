"""The causes' own curve over the nominal residuals: what the extended model predicts beyond the nominal one."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import id_of


# A curve is drawn where it makes at the measured positions what was explained there, to this share of its rms.
_SAME = 0.1


class Curve(NamedTuple):
    """Points of a line, and what the causes explain of each axis's reading there, g."""

    across: Float[np.ndarray, " points"]
    signal: Float[np.ndarray, "points 3"]


def explained(diagnosis: Diagnosis) -> Float[np.ndarray, "positions 3"]:
    """What the causes explain of the nominal residuals, g; nan where a position was left out."""
    signal = diagnosis.nominal.residuals - diagnosis.extended.residuals
    return np.where(diagnosis.extended.kept[:, None], signal, np.nan)


def by_angle(diagnosis: Diagnosis, here: Bool[np.ndarray, " positions"]) -> list[Curve]:
    """Against the spindle angle (deg) at one pitch setting, a line for each direction of approach that differs.

    **Arguments:**

    - `here`: the positions of one setting. Where what is explained does not follow from the angle (a drift), no line.
    """
    if diagnosis.extended is diagnosis.nominal:
        return []
    where, curves, missed = diagnosis.problem.where, [], 0.0
    approach = np.zeros(len(here)) if where.approach is None else np.asarray(where.approach)
    known = explained(diagnosis)
    turned = "approach" in _needs(diagnosis)
    for side in np.unique(approach[here]) if turned else [None]:
        own = np.flatnonzero(here & (approach == side)) if side is not None else np.flatnonzero(here)
        alpha = np.asarray(where.alpha)[own]
        missed += np.nansum((_signal(diagnosis, own[0], alpha) - known[own]) ** 2)
        fine = np.linspace(alpha.min(), alpha.max(), len(here))
        curves.append(Curve(np.degrees(fine), _signal(diagnosis, own[0], fine)))
    return curves if missed <= _SAME**2 * np.nansum(known[here] ** 2) else []


def by_column(diagnosis: Diagnosis, name: str, values: Float[np.ndarray, " positions"]) -> list[Curve]:
    """Against a column that the causes follow (`time_s`, `temperature_degc`), from position to position."""
    if diagnosis.extended is diagnosis.nominal or name not in _needs(diagnosis):
        return []
    known, order = explained(diagnosis), np.argsort(values, kind="stable")
    order = order[~np.isnan(known[order, 0])]
    return [Curve(values[order], known[order])]


def _needs(diagnosis: Diagnosis) -> set[str]:
    entries = [diagnosis.entries.get(id_of(cause.label)) for cause in diagnosis.members]
    return {column for entry in entries if entry is not None for column in entry.needs}


def _signal(diagnosis: Diagnosis, like: int, alpha: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points 3"]:
    """What the extended model predicts beyond the nominal one at other spindle angles (rad), all else as of one position.

    Evaluated in the rows of the data, so that nothing is compiled.
    """
    where = diagnosis.problem.where
    count = len(np.asarray(where.alpha))

    def same(column):
        return None if column is None else np.full(count, np.asarray(column)[like])

    there = replace(
        where,
        alpha=np.resize(alpha, count),
        beta=same(where.beta),
        time_s=same(where.time_s),
        temperature_degc=same(where.temperature_degc),
        approach=same(where.approach),
        groups={by: same(index) for by, index in where.groups.items()},
    )
    after, before = (diagnosis.model.predict(there, fit.vector) for fit in (diagnosis.extended, diagnosis.nominal))
    return (after - before)[: len(alpha)]
