"""The one table of candidates: every possible cause of a data set, whatever its kind, as a row; only those that are looked at
become objects."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.cause import EFFECT, GENERIC, NO_SLOT, SIGNS, Cause, Kind
from tumblecal.diagnosis.causes.together import Together
from tumblecal.diagnosis.priors import COLLINEAR
from tumblecal.effects import AXES
from tumblecal.full_model.layout import Slot
from tumblecal.ground.showing import brief


if TYPE_CHECKING:
    from tumblecal.diagnosis.causes.effects import SeenEffects

# A candidate by its number among those of its maker, from what the table has of it.
Make = Callable[[int, Cause], Cause]
_FAULTS = (Kind.SWAP, Kind.MISLABEL)
# Blocks of these ranks are enlarged together with those of the larger ranks.
_WIDTHS = np.array([0, 1, 4, 4, 4, 8])


class Blocks(NamedTuple):
    """Orthonormal bases of signals as rows, one cause after the other, and how many each has."""

    rows: Float[np.ndarray, "rows nu"]
    ranks: Int[np.ndarray, " causes"]


class Moves(NamedTuple):
    """Candidates, or groups that are one cause: their numbers (groups after the candidates), the rows of each, of which of its
    members each row is, which rows are there, and their products."""

    numbers: Int[np.ndarray, " moves"]
    columns: Int[np.ndarray, "moves width"]
    members: Int[np.ndarray, "moves width"]
    there: Bool[np.ndarray, "moves width"]
    gram: Float[np.ndarray, "moves width width"]


class _Made(dict[int, Cause]):
    """Causes by number, each made when it is asked for."""

    def __init__(self, cause: Callable[[int], Cause]):
        super().__init__()
        self._cause = cause

    def __missing__(self, number: int) -> Cause:
        return self.setdefault(number, self._cause(number))


@dataclass(frozen=True)
class Pool:
    """The candidates in a residual space of dimension `dof`.

    - `kinds`, `labels`, `log_weights`, `test_log_weights`, `slots`: of each, as of `Cause`.
    - `rows`: orthonormal bases of the signals of those with coefficients, those of the fewest directions first, and `owners`
      the candidate of each row. `offsets`: signals of those without coefficients.
    - `makers`: of each the function that makes it, and its number there.
    - `seen_effects`: visibility of every effect. `generic`: numbers of the generic terms among the candidates.
    """

    __repr__ = brief

    dof: int
    kinds: Int[np.ndarray, " causes"]
    labels: list[str]
    log_weights: Float[np.ndarray, " causes"]
    test_log_weights: Float[np.ndarray, " causes"]
    slots: list[Slot]
    rows: Float[np.ndarray, "columns nu"]
    owners: Int[np.ndarray, " columns"]
    offsets: Float[np.ndarray, "faults nu"]
    makers: list[tuple[Make, int]]
    seen_effects: "SeenEffects | None" = None
    generic: tuple[int, ...] = ()

    @classmethod
    def of_kind(
        cls,
        kind: Kind,
        labels: Sequence[str],
        log_weights: tuple[Any, Any],
        signals: Float[np.ndarray, "rows nu"],
        owners: Int[np.ndarray, " rows"] | None,
        make: Make,
        slots: Sequence[Slot] = (),
        numbers: Sequence[int] | None = None,
    ) -> Self:
        """Candidates of one kind.

        **Arguments:**

        - `log_weights`: in the posterior and in the test, of each or of all.
        - `signals`: bases as rows, one candidate after the other, and their `owners` (None: one row each); or offsets.
        - `numbers`: by which `make` knows each; if omitted, its place.
        """
        count, none = len(labels), signals[:0]
        owners = np.arange(len(signals)) if owners is None else owners
        weight, test_weight = (np.broadcast_to(np.asarray(own, float), count) for own in log_weights)
        rows, owners, offsets = (none, owners[:0], signals) if kind in _FAULTS else (signals, owners, none)
        slots, makers = list(slots) or [NO_SLOT] * count, [(make, k) for k in numbers or range(count)]
        kinds, labels = np.full(count, int(kind)), list(labels)
        return cls(signals.shape[1], kinds, labels, weight, test_weight, slots, rows, owners, offsets, makers)

    @classmethod
    def of(cls, causes: Sequence[Cause], dof: int) -> Self:
        """The table of given causes."""
        none, parts = np.zeros((0, dof)), list[Self]()
        for cause in causes:
            signals = [np.atleast_2d(own.T) for own in (cause.block, cause.offset) if own is not None]
            weights = cause.log_weight, cause.log_test_weight
            rows = np.concatenate([none, *signals])

            def made(k: int, own: Cause, cause: Cause = cause) -> Cause:
                return cause._replace(block=own.block, offset=own.offset)

            owners = np.zeros(len(rows), int)
            parts.append(cls.of_kind(cause.kind, [cause.label], weights, rows, owners, made, [cause.slot]))
        return cls.joined(parts, dof)

    @classmethod
    def joined(cls, parts: Sequence[Self], dof: int, **more: Any) -> Self:
        """Several tables as one; `more`: the last fields."""
        firsts = np.cumsum([0, *(part.size for part in parts)]).tolist()
        owners = np.concatenate([np.zeros(0, int), *(part.owners + k for part, k in zip(parts, firsts, strict=False))])
        order = np.lexsort((owners, np.bincount(owners, minlength=1)[owners]))
        # Of a thousand positions the rows need half a GiB: they are written once.
        place, rows, first = np.argsort(order), np.empty((len(owners), dof)), 0
        for part in parts:
            rows[place[first : first + len(part.rows)]] = part.rows
            first += len(part.rows)

        def each(name: str, none: np.ndarray) -> np.ndarray:
            return np.concatenate([none, *(getattr(part, name) for part in parts)])

        return cls(
            dof,
            each("kinds", np.zeros(0, int)),
            [label for part in parts for label in part.labels],
            each("log_weights", np.zeros(0)),
            each("test_log_weights", np.zeros(0)),
            [slot for part in parts for slot in part.slots],
            rows,
            owners[order],
            each("offsets", np.zeros((0, dof))),
            [maker for part in parts for maker in part.makers],
            **more,
        )

    def only(self, numbers: Int[np.ndarray, " kept"]) -> "Pool":
        """Some of the candidates, in ascending order."""
        listed, kept = numbers.tolist(), np.isin(self.owners, numbers)
        return replace(
            self,
            kinds=self.kinds[numbers],
            labels=[self.labels[k] for k in listed],
            log_weights=self.log_weights[numbers],
            test_log_weights=self.test_log_weights[numbers],
            slots=[self.slots[k] for k in listed],
            rows=self.rows[kept],
            owners=np.searchsorted(numbers, self.owners[kept]),
            offsets=self.offsets[np.isin(self.faults, numbers)],
            makers=[self.makers[k] for k in listed],
        )

    def without(self, ids: frozenset[str]) -> "Pool":
        """The table without the effects of these ids."""
        return self.only(np.array([k for k, label in enumerate(self.labels) if label not in ids], int)) if ids else self

    def in_units_of(self, sigma: float) -> "Pool":
        """The table for residuals counted in units of sigma: the signal of a coefficient has no fixed size."""
        return replace(self, offsets=self.offsets / sigma)

    @property
    def size(self) -> int:
        """Number of candidates."""
        return len(self.labels)

    @cached_property
    def causes(self) -> dict[int, Cause]:
        """The causes by number, each made when it is asked for."""
        return _Made(self._cause)

    def _cause(self, number: int) -> Cause:
        kind, (make, own) = Kind(int(self.kinds[number])), self.makers[number]
        weights = float(self.log_weights[number]), float(self.test_log_weights[number])
        cause = Cause(kind, self.labels[number], *weights, slot=self.slots[number])
        if kind in _FAULTS:
            return make(own, cause._replace(offset=self.offsets[np.searchsorted(self.faults, number)]))
        first = self.first_rows[number]
        return make(own, cause._replace(block=self.rows[first : first + self.ranks[number]].T))

    def numbers_of(self, kind: Kind) -> Int[np.ndarray, " own"]:
        """Numbers of the candidates of a kind."""
        return np.flatnonzero(self.kinds == kind)

    @cached_property
    def ranks(self) -> Int[np.ndarray, " causes"]:
        """The rank of each candidate's block, 0 where it has none."""
        return np.bincount(self.owners, minlength=self.size)

    @cached_property
    def first_rows(self) -> Int[np.ndarray, " causes"]:
        """Where the rows of each candidate begin; 0 for those without."""
        first, begin = np.zeros(self.size, int), np.flatnonzero(np.diff(self.owners, prepend=-1))
        first[self.owners[begin]] = begin
        return first

    @cached_property
    def faults(self) -> Int[np.ndarray, " faults"]:
        """Numbers of the candidates without coefficients."""
        return np.flatnonzero(np.isin(self.kinds, _FAULTS))

    @cached_property
    def offset_squares(self) -> Float[np.ndarray, " faults"]:
        """Squared norms of the offsets."""
        return np.vecdot(self.offsets, self.offsets)

    @cached_property
    def is_named(self) -> Bool[np.ndarray, " causes"]:
        """Which candidates the catalogue describes."""
        return self.kinds != GENERIC

    @cached_property
    def is_outlier(self) -> Bool[np.ndarray, " causes"]:
        """Which candidates are positions that the fit does without."""
        return self.kinds == Kind.OUTLIER

    @cached_property
    def effects(self) -> Int[np.ndarray, " effects"]:
        """Numbers of the effects of the catalogue."""
        return self.numbers_of(EFFECT)

    @property
    def visible(self) -> frozenset[str]:
        """Ids of the effects of the catalogue among the candidates."""
        return frozenset(self.labels[k] for k in self.effects.tolist())

    @cached_property
    def starts(self) -> Int[np.ndarray, " causes"]:
        """A number for each effect that is there from several starts of its time constant, the same from each; else -1."""
        variants = np.concatenate([self.effects, self.numbers_of(SIGNS)]).tolist()
        number, starts = {self.labels[k]: k for k in variants}, np.full(self.size, -1)
        own = np.array([number[self.labels[k]] for k in variants], int)
        starts[variants] = np.where(np.bincount(own, minlength=1)[own] > 1, own, -1)
        return starts

    @cached_property
    def together(self) -> Together:
        """Which effects are one cause together."""
        return Together.of(self.size, self.effects.tolist(), self.labels, self.slots)

    @cached_property
    def moves(self) -> list[Moves]:
        """What a set may be enlarged by: the candidates with coefficients, those of similar ranks together."""
        fitted = np.flatnonzero(self.ranks)
        width = _WIDTHS[np.minimum(self.ranks[fitted], len(_WIDTHS) - 1)]
        return [self._moves(own, own[:, None]) for own in (fitted[width == each] for each in np.unique(width).tolist())]

    @cached_property
    def group_moves(self) -> list[Moves]:
        """The groups of candidates that are one cause together, after the candidates."""
        listed = self.together.groups
        groups = np.array([(*own, *[-1] * (len(AXES) - len(own))) for own in listed], int).reshape(-1, len(AXES))
        return [self._moves(self.size + np.arange(len(groups)), groups)] if len(groups) else []

    def _moves(self, numbers: Int[np.ndarray, " moves"], groups: Int[np.ndarray, "moves most"]) -> Moves:
        """Groups of candidates, rows that end in -1, as moves of these numbers."""
        ranks = np.where(groups >= 0, self.ranks[groups], 0)
        slot = np.arange(int(ranks.max()))
        # The directions of each member, then those that are there.
        members = np.broadcast_to(np.arange(groups.shape[1])[:, None], (*ranks.shape, len(slot))).reshape(
            len(groups), -1
        )
        there = (slot < ranks[:, :, None]).reshape(len(groups), -1)
        order = np.argsort(~there, axis=1, kind="stable")[:, : int(there.sum(axis=1).max())]
        rows = (self.first_rows[groups][:, :, None] + slot).reshape(len(groups), -1)
        columns, members, there = (np.take_along_axis(own, order, axis=1) for own in (rows, members, there))
        columns = np.where(there, columns, 0)
        gram = np.eye(columns.shape[1]) * there[:, :, None]
        if groups.shape[1] > 1:
            signals = self.rows[columns] * there[:, :, None]
            gram = signals @ signals.mT
        return Moves(numbers, columns, members, there, gram)

    @property
    def effect_blocks(self) -> Blocks:
        """The blocks of the effects of the catalogue, and of polynomials of the temperature on all axes: one cause each."""
        own = self.kinds[self.owners] == EFFECT
        rows, ranks = [self.rows[own]], [np.sort(self.ranks[self.effects])]
        for axes in self.together.axes.tolist():
            if self.slots[axes[0]].of_several_orders:
                _, sizes, basis = np.linalg.svd(self.rows[np.isin(self.owners, axes)], full_matrices=False)
                rows.append(basis[sizes**2 > COLLINEAR])
                ranks.append(np.array([len(rows[-1])]))
        return Blocks(np.concatenate(rows), np.concatenate(ranks))
