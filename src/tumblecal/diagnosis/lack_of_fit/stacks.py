"""Processes in the residual space, those of equally many signals stacked."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.table import Blocks
from tumblecal.diagnosis.lack_of_fit.components import BySize, Components, components_of, of_one_vector
from tumblecal.diagnosis.lack_of_fit.processes import Processes
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.diagnosis.priors import LEAST_VISIBLE_TERM, SAME_TERM
from tumblecal.ground.showing import brief


# More than a bound by this share may be rounding.
_ROUNDING = 1.001


@dataclass(frozen=True)
class Stack:
    """Processes of equally many signals.

    - `numbers`: in the table of all. `signals` in the residual space as rows, those of each component together.
    - `narrow`: signals of the same covariance, of which there are no more than dimensions; their `products` with each other.
    """

    __repr__ = brief

    numbers: Int[np.ndarray, " processes"]
    signals: Float[np.ndarray, "processes signals nu"]
    narrow: Float[np.ndarray, "processes narrow nu"]
    products: Float[np.ndarray, "processes narrow narrow"]

    @classmethod
    def of(cls, numbers: Int[np.ndarray, " processes"], signals: Float[np.ndarray, "processes signals nu"]) -> "Stack":
        """The stack of these signals."""
        wide = signals.shape[1] > signals.shape[2]
        narrow = np.asarray(np.linalg.qr(signals, mode="r")) if wide else signals
        return cls(numbers, signals, narrow, narrow @ narrow.mT)

    @cached_property
    def components(self) -> Components:
        """The processes' principal components."""
        return components_of(self.products)

    @cached_property
    def directions(self) -> Float[np.ndarray, "processes nu components"]:
        """The components' directions in the residual space."""
        return self.components.directions(self.narrow.mT)

    @cached_property
    def seen(self) -> Float[np.ndarray, " processes"]:
        """Sums of squares of the signals."""
        return self.products.trace(axis1=1, axis2=2)

    @property
    def largest(self) -> Float[np.ndarray, "processes nu"]:
        """The largest of each process's narrow signals."""
        squares = self.products.diagonal(axis1=1, axis2=2)
        return self.narrow[np.arange(len(squares)), squares.argmax(axis=1)]


def stacked(at: Tangent, listed: Processes) -> tuple[Stack, ...]:
    """All processes."""
    return tuple(Stack.of(*own) for own in _signals(at, listed))


def shown(at: Tangent, listed: Processes, stacks: Sequence[Stack], effects: Blocks) -> Bool[np.ndarray, " processes"]:
    """Of which processes the residuals can show enough, and which are more than one of the effects."""
    whole, more = _whole(at, listed), np.zeros(len(listed.kinds.kind), bool)
    for stack in stacks:
        more[stack.numbers] = stack.seen > LEAST_VISIBLE_TERM**2 * whole[stack.numbers]
    for stack, near in zip(stacks, _may_hold(effects, stacks), strict=True):
        if len(near):
            more[stack.numbers[near]] &= _held(effects, stack.signals[near]) < SAME_TERM**2 * stack.seen[near]
    return more


def by_size(stacks: Sequence[Stack], numbers: Int[np.ndarray, " chosen"], z: Float[np.ndarray, "draws nu"]) -> BySize:
    """Sum of squares that some of the processes explain, by their size."""
    if len(z) == 1:
        made = of_one_vector([own.products for own in stacks], [own.narrow @ z[0] for own in stacks])
    else:
        each = [own.components.of_vectors(own.directions.mT @ z.T) for own in stacks]
        made = BySize(*(np.concatenate(part) for part in zip(*each, strict=True)))
    chosen = np.argsort(np.concatenate([own.numbers for own in stacks]))[numbers]
    return BySize(made.explained[chosen], made.half_log_dets[chosen])


def _signals(
    at: Tangent, listed: Processes
) -> Iterator[tuple[Int[np.ndarray, " processes"], Float[np.ndarray, "processes signals nu"]]]:
    """The numbers of processes with equally many fields and about as many components, and their signals in the residual
    space."""
    fields = np.ascontiguousarray((at.responses.swapaxes(0, 1) @ listed.fields).swapaxes(1, 2))
    kinds, counts = listed.kinds, listed.counts[listed.kinds.variable]
    order = np.lexsort((counts, kinds.width))
    changed = np.flatnonzero(np.diff(counts[order]) | np.diff(kinds.width[order])) + 1
    for numbers in np.split(order, changed):
        width, count = int(kinds.width[numbers[0]]), int(counts[numbers[0]])
        signals = np.empty((len(numbers), count, width * at.dof))
        ends = np.searchsorted(kinds.kind[numbers], np.arange(len(kinds.listed) + 1)).tolist()
        for kind, (first, last) in zip(kinds.listed, pairwise(ends), strict=True):
            if first < last:
                own = listed.components[:, :count][kinds.variable[numbers[first:last]]].reshape(-1, len(fields))
                followed = fields[:, kind.fields.start : kind.fields.stop].reshape(len(fields), -1)
                np.matmul(own, followed, out=signals[first:last].reshape(len(own), -1))
        yield numbers, signals.reshape(len(numbers), count * width, at.dof)


def _whole(at: Tangent, listed: Processes) -> Float[np.ndarray, " processes"]:
    """Sum of squares of each process's white signals."""
    kinds = listed.kinds
    if at.problem.correlated:
        each = (at.problem.rows(listed.process(k).signals) for k in range(len(kinds.kind)))
        return np.array([np.sum(rows**2) for rows in each])
    fields = ((listed.fields * at.whole_responses[:, :, None]) ** 2).sum(axis=1)
    each = fields.T @ (listed.components**2).sum(axis=1).T
    summed = np.concatenate([np.zeros((1, each.shape[1])), each.cumsum(axis=0)])
    return summed[kinds.first_field + kinds.width, kinds.variable] - summed[kinds.first_field, kinds.variable]


def _may_hold(effects: Blocks, stacks: Sequence[Stack]) -> list[Int[np.ndarray, " near"]]:
    """Which processes of each stack one of the effects may contain."""
    seen, largest = (np.concatenate(part) for part in zip(*((own.seen, own.largest) for own in stacks), strict=True))
    squares = np.concatenate([np.vecdot(own.products, own.products).sum(axis=1) for own in stacks])
    # A block leaves of all signals no less than of the largest. It contains no more than as many of the components' variances
    # as it has directions, and any r of them are together no more than the root of r times the sum of the squares of all.
    left = np.vecdot(largest, largest) - _by_effect(effects, (effects.rows @ largest.T) ** 2)
    near = left <= _ROUNDING * (1 - SAME_TERM**2) * seen
    near &= effects.ranks[:, None] * squares >= (SAME_TERM**2 / _ROUNDING * seen) ** 2
    ends = np.cumsum([0, *(len(own.numbers) for own in stacks)]).tolist()
    processes = near.any(axis=0)
    return [np.flatnonzero(processes[first:last]) for first, last in pairwise(ends)]


def _held(effects: Blocks, signals: Float[np.ndarray, "processes signals nu"]) -> Float[np.ndarray, " processes"]:
    """The largest share of the signals' sums of squares that one of the effects contains."""
    return _by_effect(effects, ((signals @ effects.rows.T) ** 2).sum(axis=1).T).max(axis=0)


def _by_effect(effects: Blocks, squares: Float[np.ndarray, "rows processes"]) -> Float[np.ndarray, "effects processes"]:
    """What stands for each row, summed over those of each effect."""
    first = np.cumsum(effects.ranks) - effects.ranks
    return np.add.reduceat(squares, first, axis=0) if len(first) else squares
