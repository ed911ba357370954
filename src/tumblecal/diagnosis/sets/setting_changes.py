"""Jumps that begin at a change of setting: a difference by setting makes the same signal.

A bias that jumps between two pitch settings is a bias by pitch setting of which all settings before have one value and all
after have another: a special case of it, with fewer coefficients. No reading shows whether the jump came at that moment by
chance or with the change of setting. The evidence, which assumes unrelated coefficients of an effect by setting, only states
how rare such values would be.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.causes.cause import id_of
from tumblecal.diagnosis.causes.jumps import JUMPS
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.ground.showing import brief


@dataclass(frozen=True)
class SettingChanges:
    """Where the index columns of a problem's settings (pitch, run, ...) change in measuring order."""

    __repr__ = brief

    at: Tangent

    def special_cases(self, sets: Sequence[Sequence[str]]) -> Bool[np.ndarray, "sets sets"]:
        """Of which pairs of sets of labels the first has a jump that begins where a column changes by which an effect of the
        second goes."""
        columns = tuple(self.at.problem.where.groups)
        begun = np.array([[column in own for column in columns] for own in map(self._begun, sets)], float)
        return begun @ self._by_column(sets).T > 0

    def by_same_setting(self, sets: Sequence[Sequence[str]]) -> Bool[np.ndarray, "sets sets"]:
        """Pairs of sets of labels that both have an effect with a coefficient for each value of the same column."""
        followed = self._by_column(sets)
        return followed @ followed.T > 0

    def _by_column(self, sets: Sequence[Sequence[str]]) -> Float[np.ndarray, "sets columns"]:
        columns = tuple(self.at.problem.where.groups)
        return np.array([[column in own for column in columns] for own in map(self._followed, sets)], float)

    def _begun(self, labels: Sequence[str]) -> set[str]:
        """The columns that change where the jumps of a set begin."""
        begins = (label.partition(":")[2] for label in labels if id_of(label) in JUMPS)
        return {column for name in begins for column in self._changed.get(name, ())}

    def _followed(self, labels: Sequence[str]) -> set[str]:
        """The columns by which the effects of a set go."""
        return {column for label in labels for column in self._needs.get(label, ())}

    @cached_property
    def _needs(self) -> dict[str, tuple[str, ...]]:
        return {slot.id: slot.needs for slot in self.at.model.layout.slots}

    @cached_property
    def _changed(self) -> dict[str, list[str]]:
        """By the position's name, the columns of which it is the first of another group."""
        problem, changed = self.at.problem, dict[str, list[str]]()
        order = np.argsort(problem.where.measuring_order, kind="stable")
        for column, index in problem.where.groups.items():
            ordered = np.asarray(index)[order]
            for k in (1 + np.flatnonzero(ordered[1:] != ordered[:-1])).tolist():
                changed.setdefault(problem.names[order[k]], []).append(column)
        return changed
