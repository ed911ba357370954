"""Processes in the residual space, those of equally many signals stacked."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.lack_of_fit.components import BySize, Components, components_of, of_one_vector
from tumblecal.diagnosis.lack_of_fit.processes import Processes
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.diagnosis.tuning import LEAST_VISIBLE_TERM, SAME_TERM
from tumblecal.ground.showing import brief


# Less than a bound by this share may be rounding.
_ROUNDING = 0.999


@dataclass(frozen=True)
class Stack:
    """Processes of equally many signals.

    - `numbers`: in the table of all. `signals` in the residual space, field after field.
    - `narrow`: signals of the same covariance, of which there are no more than dimensions; their `products` with each other.
    """

    __repr__ = brief

    numbers: Int[np.ndarray, " processes"]
    signals: Float[np.ndarray, "processes nu signals"]
    narrow: Float[np.ndarray, "processes nu narrow"]
    products: Float[np.ndarray, "processes narrow narrow"]

    @classmethod
    def of(cls, numbers: Int[np.ndarray, " processes"], signals: Float[np.ndarray, "processes nu signals"]) -> "Stack":
        """That of these signals."""
        narrow = signals
        if signals.shape[2] > signals.shape[1]:
            narrow = np.swapaxes(np.linalg.qr(np.swapaxes(signals, 1, 2), mode="r"), 1, 2)
        return cls(numbers, signals, narrow, np.swapaxes(narrow, 1, 2) @ narrow)

    @cached_property
    def components(self) -> Components:
        """The processes' principal components."""
        return components_of(self.products)

    @cached_property
    def directions(self) -> Float[np.ndarray, "processes nu components"]:
        """The components' directions in the residual space."""
        return self.components.directions(self.narrow)

    @property
    def seen(self) -> Float[np.ndarray, " processes"]:
        """Sums of squares of the signals."""
        return np.trace(self.products, axis1=1, axis2=2)


def stacked(at: Tangent, listed: Processes) -> tuple[Stack, ...]:
    """All processes."""
    return tuple(Stack.of(*own) for own in _signals(at, listed))


def shown(
    at: Tangent, listed: Processes, stacks: Sequence[Stack], effects: Sequence[Float[np.ndarray, "nu rank"]]
) -> Bool[np.ndarray, " processes"]:
    """Of which processes the residuals can show enough, and which are more than one of the effects."""
    more, whole, blocks = np.zeros(len(listed.variable), bool), _whole(at, listed), _Blocks.of(effects)
    for stack in stacks:
        enough = stack.seen > LEAST_VISIBLE_TERM**2 * whole[stack.numbers]
        more[stack.numbers] = enough & ~blocks.hold(stack)
    return more


def by_size(stacks: Sequence[Stack], z: Float[np.ndarray, "draws nu"]) -> BySize:
    """What all processes explain by their size, in the order of the table."""
    if len(z) == 1:
        made = of_one_vector([own.products for own in stacks], [z[0] @ own.narrow for own in stacks])
    else:
        each = [own.components.of_vectors(np.swapaxes(own.directions, 1, 2) @ z.T) for own in stacks]
        made = BySize(*(np.concatenate(part) for part in zip(*each, strict=True)))
    order = np.argsort(np.concatenate([own.numbers for own in stacks]))
    return BySize(made.explained[order], made.half_log_dets[order])


def _signals(
    at: Tangent, listed: Processes
) -> Iterator[tuple[Int[np.ndarray, " processes"], Float[np.ndarray, "processes nu signals"]]]:
    """The numbers of processes with equally many fields and about as many components, and their signals in the residual
    space."""
    fields = np.ascontiguousarray((at.responses.swapaxes(0, 1) @ listed.fields).transpose(2, 1, 0))
    counts = listed.counts[listed.variable]
    for width, count in sorted(set(zip(listed.width.tolist(), counts.tolist(), strict=True))):
        numbers = np.flatnonzero((listed.width == width) & (counts == count))
        own = listed.components[listed.variable[numbers], None, :, :count]
        signals = fields[listed.first_field[numbers][:, None] + np.arange(width)] @ own
        yield numbers, signals.swapaxes(1, 2).reshape(len(numbers), at.dof, width * count)


def _whole(at: Tangent, listed: Processes) -> Float[np.ndarray, " processes"]:
    """Sum of squares of each process's white signals."""
    if at.problem.correlated:
        each = (at.problem.rows(listed.process(k).signals) for k in range(len(listed.variable)))
        return np.array([np.sum(rows**2) for rows in each])
    fields = np.sum((listed.fields * at.whole_responses[:, :, None]) ** 2, axis=1)
    each = fields.T @ np.sum(listed.components**2, axis=2).T
    summed = np.concatenate([np.zeros((1, each.shape[1])), np.cumsum(each, axis=0)])
    return summed[listed.first_field + listed.width, listed.variable] - summed[listed.first_field, listed.variable]


class _Blocks(NamedTuple):
    """Orthonormal blocks of the effects side by side, those of the highest rank first."""

    columns: Float[np.ndarray, "columns nu"]
    ranks: Int[np.ndarray, " effects"]

    @classmethod
    def of(cls, effects: Sequence[Float[np.ndarray, "nu rank"]]) -> "_Blocks":
        each = sorted((block.T for block in effects), key=len, reverse=True)
        return cls(np.concatenate(each) if each else np.zeros((0, 0)), np.array([len(own) for own in each], int))

    def hold(self, stack: Stack) -> Bool[np.ndarray, " processes"]:
        """Which processes have nearly all of their variance in what one of the effects can make."""
        held, seen = np.zeros(len(stack.numbers), bool), stack.seen
        # A block holds no more than as many of the components' variances as it has directions, and any r of them are together
        # no more than the root of r times the sum of the squares of all.
        squares = np.einsum("pst,pst->p", stack.products, stack.products)
        least = np.ceil((_ROUNDING * SAME_TERM**2 * seen) ** 2 / np.maximum(squares, 1e-300)).astype(int)
        for rank in sorted(set(least.tolist())):
            ranks = self.ranks[self.ranks >= rank]
            if not len(ranks):
                break
            near = np.flatnonzero(least == rank)
            squares = np.sum((self.columns[: np.sum(ranks)] @ stack.signals[near]) ** 2, axis=2)
            by_effect = np.add.reduceat(squares, np.cumsum(ranks) - ranks, axis=1)
            held[near] = seen[near] <= np.max(by_effect, axis=1) / SAME_TERM**2
        return held
