"""Causes that go by the same setting (pitch, run, ...): an effect with a coefficient for each value, or a jump at a change.

A bias that jumps between two pitch settings is a bias by pitch setting of two values, and where an input is constant within a
setting, a bias and a scale factor by setting are one signal. No reading shows which it is; the evidence only states how rare
such coefficients, or a jump at that moment, would be.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool

from tumblecal.diagnosis.causes.terms import JUMPS
from tumblecal.diagnosis.sets.exchanges import membership
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


@dataclass(frozen=True)
class SettingChanges:
    """Where the index columns of a problem's settings (pitch, run, ...) change in measuring order."""

    __repr__ = brief

    at: Tangent

    def pairs(
        self, sets: Sequence[Sequence[str]]
    ) -> tuple[Bool[np.ndarray, "sets sets"], Bool[np.ndarray, "sets sets"]]:
        """Pairs of sets of labels that go by the same column: the first by a jump and the second by an effect; both by
        effects."""
        columns, needs = tuple(self.at.problem.where.groups), self.at.model.layout.needs
        has, names = membership(sets)
        follows, begins = (
            has
            @ np.array([[column in of.get(name, ()) for column in columns] for name in names], float).reshape(
                -1, len(columns)
            )
            for of in (needs, self._begun)
        )
        return begins @ follows.T > 0, follows @ follows.T > 0

    @cached_property
    def _begun(self) -> dict[str, list[str]]:
        """By the label of a jump, the columns of which its position is the first of another group."""
        problem, begun = self.at.problem, dict[str, list[str]]()
        order = np.argsort(problem.where.measuring_order, kind="stable")
        for column, index in problem.where.groups.items():
            ordered = np.asarray(index)[order]
            for k in (1 + np.flatnonzero(ordered[1:] != ordered[:-1])).tolist():
                for id in JUMPS:
                    begun.setdefault(f"{id}:{problem.names[order[k]]}", []).append(column)
        return begun
