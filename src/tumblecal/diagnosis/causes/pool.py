"""All causes of one data set, stacked for batched linear algebra."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.cause import EFFECT, NO_SLOT, Cause, Kind
from tumblecal.diagnosis.causes.clipped import clipped
from tumblecal.diagnosis.causes.effects import SeenEffects, effect_causes, seen_effects
from tumblecal.diagnosis.causes.faults import FAULTS, OUTLIER
from tumblecal.diagnosis.causes.generic import generic_causes
from tumblecal.diagnosis.causes.jumps import jumps
from tumblecal.diagnosis.causes.shapes import shape_causes
from tumblecal.diagnosis.causes.sign_variants import SIGNS
from tumblecal.diagnosis.causes.table import Blocks, CauseTable, MadeCauses, tables_of
from tumblecal.diagnosis.causes.together import Together, family_bases, on_axes, polynomials
from tumblecal.diagnosis.priors import FAMILY_TEST_WEIGHT
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.tangent import Tangent
from tumblecal.full_model.visibility import Visibility
from tumblecal.ground.showing import brief


class Tested(NamedTuple):
    """Orthonormal blocks side by side, the first column of each, its number of columns, and the logarithm of its weight in the
    test."""

    columns: Float[np.ndarray, "nu columns"]
    first: Int[np.ndarray, " blocks"]
    ranks: Int[np.ndarray, " blocks"]
    log_weights: Float[np.ndarray, " blocks"]


@dataclass(frozen=True)
class Pool:
    """The causes in a residual space of dimension `dof`, kind by kind.

    `seen_effects`: visibility of every effect. `generic`: the numbers of the generic terms among the causes.
    """

    __repr__ = brief

    tables: tuple[CauseTable, ...]
    dof: int
    seen_effects: SeenEffects | None = None
    generic: tuple[int, ...] = ()

    @classmethod
    def of(cls, causes: Sequence[Cause], dof: int) -> "Pool":
        """The pool of given causes."""
        return cls(tables_of(causes, dof), dof)

    @cached_property
    def causes(self) -> Sequence[Cause]:
        """The causes, each made when it is asked for."""
        return MadeCauses(self.tables)

    @cached_property
    def seen(self) -> tuple[Visibility, ...]:
        """Visibility of every effect."""
        return tuple(self.seen_effects or ())

    @cached_property
    def _first(self) -> list[int]:
        """The number of each table's first cause, and of all causes."""
        return np.cumsum([0, *(len(table) for table in self.tables)]).tolist()

    @property
    def size(self) -> int:
        """Number of causes."""
        return self._first[-1]

    def numbers_of(self, kind: Kind) -> Int[np.ndarray, " own"]:
        """Indices of the causes of a kind."""
        listed = zip(self.tables, self._first, strict=False)
        own = (np.arange(first, first + len(table)) for table, first in listed if table.kind is kind)
        return np.concatenate([np.zeros(0, int), *own])

    @cached_property
    def labels(self) -> list[str]:
        """The label of every cause."""
        return [label for table in self.tables for label in table.labels]

    @cached_property
    def _owners(self) -> Int[np.ndarray, " columns"]:
        """Whose the rows of the tables with coefficients are, table by table."""
        listed = zip(self.tables, self._first, strict=False)
        return np.concatenate([np.zeros(0, int), *[table.owners + first for table, first in listed if table.fitted]])

    @cached_property
    def ranks(self) -> Int[np.ndarray, " causes"]:
        """The rank of each cause's block, 0 where it has none."""
        return np.bincount(self._owners, minlength=self.size)

    @cached_property
    def is_fault(self) -> Bool[np.ndarray, " causes"]:
        """Which causes have no coefficients."""
        return self._of_tables([not table.fitted for table in self.tables])

    @cached_property
    def faults(self) -> Int[np.ndarray, " faults"]:
        """Indices of the causes without coefficients."""
        return np.flatnonzero(self.is_fault)

    @cached_property
    def blocks(self) -> Int[np.ndarray, " blocks"]:
        """Indices of the causes with coefficients, those of the lowest rank first."""
        have = np.flatnonzero(~self.is_fault)
        return have[np.argsort(self.ranks[have], kind="stable")]

    def _of_tables(self, values: list[bool]) -> Bool[np.ndarray, " causes"]:
        """A property of a whole table, repeated for every cause."""
        return np.repeat(np.array(values, bool), np.diff(self._first))

    @cached_property
    def stacked(self) -> Float[np.ndarray, "nu columns"]:
        """All blocks side by side, in the order of `blocks`."""
        stored = next((table.rows for table in self.tables if table.places is not None), np.zeros((0, self.dof)))
        if all(table.rows is stored for table in self.tables if table.fitted) and len(stored) == len(self._owners):
            return stored.T
        columns, first, stacked = self._columns, 0, np.empty((len(self._owners), self.dof))
        for table in self.tables:
            if table.fitted:
                stacked[columns[first : first + len(table.owners)]] = table.own_rows
                first += len(table.owners)
        return stacked.T

    @cached_property
    def _columns(self) -> Int[np.ndarray, " columns"]:
        """Where the rows of the tables with coefficients are in `stacked`, table by table."""
        return np.argsort(np.argsort(self.ranks[self._owners] * self.size + self._owners, kind="stable"))

    @property
    def stored_once(self) -> "Pool":
        """The pool whose tables refer to `stacked`: of a thousand positions, the rows need half a GiB."""
        columns, first, tables, stored = self._columns, 0, list[CauseTable](), self.stacked.T
        for table in self.tables:
            if table.fitted:
                places = columns[first : first + len(table.owners)]
                first += len(places)
                table = replace(table, rows=stored, places=places)
            tables.append(table)
        return replace(self, tables=tuple(tables))

    @cached_property
    def first_columns(self) -> Int[np.ndarray, " causes"]:
        """Where each cause's columns begin in `stacked`; 0 for those without a block."""
        first, ranks = np.zeros(self.size, int), self.ranks[self.blocks]
        first[self.blocks] = np.cumsum(ranks) - ranks
        return first

    @cached_property
    def offsets(self) -> Float[np.ndarray, "nu faults"]:
        """All offsets side by side."""
        rows = (table.rows for table in self.tables if not table.fitted)
        return np.concatenate([np.zeros((0, self.dof)), *rows]).T

    @cached_property
    def offset_squares(self) -> Float[np.ndarray, " faults"]:
        """Squared norms of the offsets."""
        return np.vecdot(self.offsets.T, self.offsets.T)

    @cached_property
    def is_named(self) -> Bool[np.ndarray, " causes"]:
        """Which causes the catalogue describes."""
        return self._of_tables([table.kind.named for table in self.tables])

    @cached_property
    def is_outlier(self) -> Bool[np.ndarray, " causes"]:
        """Which causes are positions that the fit does without."""
        return self._of_tables([table.kind is OUTLIER for table in self.tables])

    @cached_property
    def outlying(self) -> frozenset[int]:
        """Indices of the outlying positions among the causes."""
        return frozenset(np.flatnonzero(self.is_outlier).tolist())

    @cached_property
    def effects(self) -> Int[np.ndarray, " effects"]:
        """Indices of the effects of the catalogue."""
        return self.numbers_of(EFFECT)

    @property
    def effect_blocks(self) -> Blocks:
        """The blocks of the effects of the catalogue, and of polynomials of the temperature on all axes: one cause each."""
        rows = [table.own_rows for table in self.tables if table.kind is EFFECT]
        several = np.array([self.slots[first].of_several_orders for first in self.axes[:, 0].tolist()], bool)
        axes = self.axes[several]
        bases, ranks = family_bases(self.stacked.T, self.first_columns[axes], self.ranks[axes])
        rows = np.concatenate([np.zeros((0, self.dof)), *rows, bases])
        return Blocks(rows, np.concatenate([self.ranks[self.effects], ranks]))

    @property
    def visible(self) -> frozenset[str]:
        """Ids of the effects of the catalogue among the causes."""
        return frozenset(self.labels[k] for k in self.effects.tolist())

    @cached_property
    def starts(self) -> Int[np.ndarray, " causes"]:
        """A number for each effect that is there from several starts of its time constant, the same from each; else -1."""
        variants = np.concatenate([self.effects, self.numbers_of(SIGNS)])
        labels, starts = [self.labels[k] for k in variants.tolist()], np.full(self.size, -1)
        if len(set(labels)) < len(labels):
            number = {label: k for k, label in enumerate(labels)}
            own = np.array([number[label] for label in labels])
            starts[variants] = np.where(np.bincount(own)[own] > 1, own, -1)
        return starts

    @cached_property
    def axes(self) -> Int[np.ndarray, "families 3"]:
        """The causes of each family (`second_order` of `second_order.x`) that is seen on all three axes, axis by axis."""
        return self.effects[on_axes(tuple([self.labels[k] for k in self.effects.tolist()]))]

    @cached_property
    def slots(self) -> list[Slot]:
        """The slot of every cause, `NO_SLOT` for those without."""
        return [slot for table in self.tables for slot in (table.slots or [NO_SLOT] * len(table))]

    @cached_property
    def together(self) -> Together:
        """Which effects are one cause together."""
        effects = self.effects.tolist()
        listed = polynomials([self.slots[k] for k in effects])
        return Together(self.size, self.axes, tuple([tuple([effects[number] for number in own]) for own in listed]))

    @cached_property
    def tested(self) -> tuple[Tested, Tested]:
        """As the test takes them: the causes with coefficients, and the families on all three axes, which share a weight."""
        seen = self.blocks[self.ranks[self.blocks] > 0]
        alone = Tested(self.stacked, self.first_columns[seen], self.ranks[seen], self.test_log_weights[seen])
        families, ranks = family_bases(self.stacked.T, self.first_columns[self.axes], self.ranks[self.axes])
        weights = np.full(len(ranks), np.log(FAMILY_TEST_WEIGHT / max(len(self.axes), 1)))
        return alone, Tested(families.T, np.cumsum(ranks) - ranks, ranks, weights)

    @cached_property
    def test_log_weights(self) -> Float[np.ndarray, " causes"]:
        """Logarithms of the weights in the test."""
        return np.concatenate([np.zeros(0), *(table.log_test_weights for table in self.tables)])

    @cached_property
    def log_weights(self) -> Float[np.ndarray, " causes"]:
        """Logarithms of the prior weights."""
        return np.concatenate([np.zeros(0), *(table.log_weights for table in self.tables)])

    def only(self, numbers: Int[np.ndarray, " kept"]) -> "Pool":
        """The pool of some of the causes, in ascending order."""
        bounds = np.searchsorted(numbers, self._first).tolist()
        parts = zip(self.tables, self._first, bounds, bounds[1:], strict=False)
        return Pool(tuple(table.only(numbers[a:b] - first) for table, first, a, b in parts), self.dof)

    def without(self, ids: frozenset[str]) -> "Pool":
        """The pool without the effects of these ids."""
        if not ids:
            return self
        kept = self.only(np.array([k for k, label in enumerate(self.labels) if label not in ids], int))
        return replace(kept, seen_effects=self.seen_effects, generic=self.generic)

    def in_units_of(self, sigma: float) -> "Pool":
        """The pool for residuals counted in units of sigma."""
        if sigma == 1.0:
            return self
        return replace(self, tables=tuple(table.in_units_of(sigma) for table in self.tables))


def pooled(
    at: Tangent,
    level: float,
    generic: tuple[int, ...] | None = None,
    visible: frozenset[str] | None = None,
) -> Pool:
    """Effects of the catalogue, faults of single positions, jumps at one, and generic terms.

    **Arguments:**

    - `level`: sd of the white rows; faults smaller than a few of it are no candidates.
    - `generic`: numbers of the generic terms to use; if omitted, they are selected here.
    - `visible`: the effects that are visible without any error, as in `causes.effects`.
    """
    seen = seen_effects(at)
    effects = effect_causes(at, seen, visible)
    faults = (table for candidates in FAULTS if (table := candidates(at, level)) is not None)
    terms, generic = generic_causes(at, effects, generic)
    tables = (effects, *faults, *clipped(at), *jumps(at), terms, *shape_causes(at))
    return Pool(tables, at.dof, seen, generic).stored_once
