"""Causes of one kind, as arrays: of a thousand candidates, few are evaluated separately, and only those become objects."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import NamedTuple, overload

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.cause import NO_SLOT, Cause, Kind
from tumblecal.full_model.layout import Slot
from tumblecal.ground.showing import brief


# Number in the table, label, logarithms of the weights in the posterior and in the test, signal.
Make = Callable[[int, str, tuple[float, float], np.ndarray], Cause]


class Blocks(NamedTuple):
    """Orthonormal bases of signals as rows, one cause after the other, and how many each has."""

    rows: Float[np.ndarray, "rows nu"]
    ranks: Int[np.ndarray, " causes"]


@dataclass(frozen=True)
class CauseTable:
    """Causes of one kind.

    - `labels`, `log_weights`, `log_test_weights`: as of `Cause`.
    - `rows`: orthonormal bases of their signals as rows, one cause after the other, and `owners` the cause of each row; of
      causes without coefficients the offset of each. With `places`: all rows of a pool, and where these are among them.
    - `make`: one of them as a `Cause`. `slots`: the slot of each, if they have any.
    """

    __repr__ = brief

    kind: Kind
    labels: Sequence[str]
    log_weights: Float[np.ndarray, " causes"]
    log_test_weights: Float[np.ndarray, " causes"]
    rows: Float[np.ndarray, "rows nu"]
    owners: Int[np.ndarray, " rows"]
    make: Make
    slots: Sequence[Slot] = ()
    places: Int[np.ndarray, " own"] | None = None

    def __len__(self) -> int:
        return len(self.log_weights)

    @property
    def fitted(self) -> bool:
        """Whether the causes have coefficients."""
        return self.kind.fitted

    @property
    def own_rows(self) -> Float[np.ndarray, "own nu"]:
        """Their rows alone."""
        return self.rows if self.places is None else self.rows[self.places]

    @cached_property
    def _ends(self) -> list[int]:
        return np.searchsorted(self.owners, np.arange(len(self) + 1)).tolist()

    def block(self, number: int) -> Float[np.ndarray, "nu rank"]:
        """Orthonormal basis of a cause's signal; of causes without coefficients the offset."""
        own = slice(self._ends[number], self._ends[number + 1])
        return (self.rows[own] if self.places is None else self.rows[self.places[own]]).T

    def cause(self, number: int) -> Cause:
        """The cause of a number."""
        weights = float(self.log_weights[number]), float(self.log_test_weights[number])
        block = self.block(number)
        return self.make(number, self.labels[number], weights, block if self.fitted else block[:, 0])

    def only(self, numbers: Int[np.ndarray, " kept"]) -> "CauseTable":
        """Some of the causes, in ascending order."""
        if len(numbers) == len(self):
            return self
        kept, make = np.isin(self.owners, numbers), self.make
        return replace(
            self,
            labels=[self.labels[k] for k in numbers.tolist()],
            log_weights=self.log_weights[numbers],
            log_test_weights=self.log_test_weights[numbers],
            rows=self.own_rows[kept],
            places=None,
            owners=np.searchsorted(numbers, self.owners[kept]),
            make=lambda k, *properties: make(int(numbers[k]), *properties),
            slots=[self.slots[k] for k in numbers.tolist()] if self.slots else (),
        )

    def in_units_of(self, sigma: float) -> "CauseTable":
        """The table for residuals in units of sigma: the signal of a coefficient has no fixed size."""
        return self if self.fitted else replace(self, rows=self.rows / sigma)


def equally_weighted(
    kind: Kind,
    labels: Sequence[str],
    log_weights: tuple[float, float],
    rows: Float[np.ndarray, "rows nu"],
    owners: Int[np.ndarray, " rows"] | None,
    make: Make,
) -> CauseTable:
    """Causes with equal weights; without `owners`: one row each."""
    weight, test_weight = (np.full(len(labels), weight) for weight in log_weights)
    owners = np.arange(len(rows)) if owners is None else owners
    return CauseTable(kind, labels, weight, test_weight, rows, owners, make)


def tables_of(causes: Sequence[Cause], dof: int) -> tuple[CauseTable, ...]:
    """Tables of given causes, one for each sequence of the same kind; `dof`: dimension of the residual space."""
    return tuple(_table_of(kind, list(own), dof) for kind, own in groupby(causes, lambda cause: cause.kind))


def _table_of(kind: Kind, causes: list[Cause], dof: int) -> CauseTable:
    signals = [
        np.atleast_2d(signal.T) for cause in causes for signal in (cause.block, cause.offset) if signal is not None
    ]
    field = "block" if kind.fitted else "offset"
    return CauseTable(
        kind,
        [cause.label for cause in causes],
        np.array([cause.log_weight for cause in causes]),
        np.array([cause.log_test_weight for cause in causes]),
        np.concatenate([np.zeros((0, dof)), *signals]),
        np.repeat(np.arange(len(causes)), [len(rows) for rows in signals]),
        lambda k, label, weights, signal: causes[k]._replace(**{field: signal}),
        [] if all(cause.slot is NO_SLOT for cause in causes) else [cause.slot for cause in causes],
    )


class MadeCauses(Sequence[Cause]):
    """The causes of several tables as a sequence; each is made when it is asked for, and kept."""

    def __init__(self, tables: Sequence[CauseTable]):
        self._tables, self._made = tables, dict[int, Cause]()
        self._ends = np.cumsum([len(table) for table in tables], dtype=int)

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    @overload
    def __getitem__(self, number: int) -> Cause: ...
    @overload
    def __getitem__(self, number: slice) -> tuple[Cause, ...]: ...

    def __getitem__(self, number: int | slice) -> Cause | tuple[Cause, ...]:
        """A cause, or some."""
        if isinstance(number, slice):
            return tuple(self._of(k) for k in range(len(self))[number])
        return self._of(range(len(self))[number])

    def __iter__(self) -> Iterator[Cause]:
        return (self._of(k) for k in range(len(self)))

    def _of(self, number: int) -> Cause:
        if number not in self._made:
            table = int(np.searchsorted(self._ends, number, "right"))
            own = self._tables[table]
            self._made[number] = own.cause(number - int(self._ends[table]) + len(own))
        return self._made[number]
