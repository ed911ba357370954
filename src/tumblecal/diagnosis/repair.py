"""Undo what went wrong in the procedure: exchange readings back, correct an angle, leave a position out."""

from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from tumblecal.chain import Where
from tumblecal.diagnosis.candidates import Candidate
from tumblecal.diagnosis.gross import steps


@dataclass(frozen=True)
class Repaired:
    """Data with the named faults undone; `keep` says which positions take part in the fit."""

    where: Where
    readings: Float[np.ndarray, "positions 3"]
    keep: Bool[np.ndarray, " positions"]


def repaired(where: Where, readings: Float[np.ndarray, "positions 3"], faults: list[Candidate]) -> Repaired:
    """The data with the faults of an explanation undone.

    **Arguments:**

    - `where`, `readings`: as measured.
    - `faults`: candidates of the families swap, mislabel and outlier; others are left alone.
    """
    readings, keep = readings.copy(), np.ones(len(readings), bool)
    for fault in faults:
        if fault.family == "swap":
            i, j = fault.positions
            readings[[i, j]] = readings[[j, i]]
        elif fault.family == "mislabel":
            where = _relabelled(where, fault)
        elif fault.family == "outlier":
            keep[list(fault.positions)] = False
    return Repaired(where, readings, keep)


def _relabelled(where: Where, fault: Candidate) -> Where:
    moved = next(other for words, other, _ in steps(where) if words == fault.words)
    (position,) = fault.positions

    def taken(old, new):
        changed = np.array(old)
        changed[position] = np.asarray(new)[position]
        return changed

    groups = {name: taken(index, moved.groups[name]) for name, index in where.groups.items()}
    return eqx.tree_at(
        lambda w: (w.alpha, w.beta, w.groups),
        where,
        (taken(where.alpha, moved.alpha), taken(where.beta, moved.beta), groups),
    )
