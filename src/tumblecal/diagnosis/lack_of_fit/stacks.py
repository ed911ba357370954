"""Processes in the residual space, those of equally many signals stacked."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.table import Blocks
from tumblecal.diagnosis.lack_of_fit.components import Components
from tumblecal.diagnosis.lack_of_fit.processes import Processes
from tumblecal.diagnosis.priors import LEAST_VISIBLE_TERM, SAME_TERM
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


# More than a bound by this share may be rounding.
_ROUNDING = 1.001


@dataclass(frozen=True)
class Stack:
    """Processes of equally many signals: their `numbers` in the table of all, and the signals in the residual space as rows,
    those of each component together."""

    __repr__ = brief

    numbers: Int[np.ndarray, " processes"]
    signals: Float[np.ndarray, "processes signals nu"]

    @cached_property
    def products(self) -> Float[np.ndarray, "processes signals signals"]:
        """Products of the signals with each other."""
        return self.signals @ self.signals.mT

    @cached_property
    def seen(self) -> Float[np.ndarray, " processes"]:
        """Sums of squares of the signals."""
        return self.products.trace(axis1=1, axis2=2)

    @cached_property
    def components(self) -> Components:
        """The processes' principal components."""
        return Components.of(self.products)

    @cached_property
    def directions(self) -> Float[np.ndarray, "processes nu components"]:
        """The components' directions in the residual space."""
        return self.signals.mT @ self.components.normalised


def stacked(at: Tangent, listed: Processes) -> tuple[Stack, ...]:
    """All processes, by their numbers of fields and, about, of components."""
    kinds, count_of, dof = listed.kinds, listed.counts[listed.kinds.variable], at.dof
    stacks, of_fields = list[Stack](), dict[tuple[int, int], list[tuple[Stack, int, int]]]()
    for width, count in sorted({*zip(kinds.width.tolist(), count_of.tolist(), strict=True)}):
        numbers = np.flatnonzero((kinds.width == width) & (count_of == count))
        stacks.append(Stack(numbers, np.empty((len(numbers), count * width, dof))))
        first = kinds.first_field[numbers]
        ends = [0, *(np.flatnonzero(first[1:] != first[:-1]) + 1).tolist(), len(numbers)]
        for low, high in pairwise(ends):
            of_fields.setdefault((int(first[low]), width), []).append((stacks[-1], low, high))
    # One kind of fields at a time: those of all need more memory than the signals.
    for (first, width), parts in of_fields.items():
        followed = at.responses.swapaxes(0, 1) @ listed.fields[:, :, first : first + width]
        followed = followed.swapaxes(1, 2).reshape(len(followed), -1)
        for stack, low, high in parts:
            count = stack.signals.shape[1] // width
            components = listed.components[:, :count][kinds.variable[stack.numbers[low:high]]].reshape(
                -1, len(followed)
            )
            np.matmul(components, followed, out=stack.signals[low:high].reshape(len(components), -1))
    return tuple(stacks)


def shown(at: Tangent, listed: Processes, stacks: Sequence[Stack], effects: Blocks) -> Bool[np.ndarray, " processes"]:
    """Of which processes the residuals can show enough, and which are more than one of the effects."""
    seen, ends = np.concatenate([own.seen for own in stacks]), np.cumsum([len(own.numbers) for own in stacks])
    whole, more = _whole(at, listed), np.zeros(len(seen), bool)
    for stack, near in zip(stacks, np.split(_may_be_an_effect(stacks, seen, ends, effects), ends[:-1]), strict=True):
        more[stack.numbers] = stack.seen > LEAST_VISIBLE_TERM**2 * whole[stack.numbers]
        if np.any(near):
            held = _held(effects, ((stack.signals[near] @ effects.rows.T) ** 2).sum(axis=1).T)
            more[stack.numbers[near]] &= held < SAME_TERM**2 * stack.seen[near]
    return more


def _may_be_an_effect(
    stacks: Sequence[Stack], seen: Float[np.ndarray, " processes"], ends: Int[np.ndarray, " stacks"], effects: Blocks
) -> Bool[np.ndarray, " processes"]:
    """Which processes, stack by stack, one of the effects may contain, by two bounds: of all signals no less remains than of
    the largest; and as many of the components' variances as an effect has directions, r, are together no more than the root of
    r times the sum of the squares of all."""
    largest, variances = np.empty((len(seen), stacks[0].signals.shape[2])), np.empty(len(seen))
    for stack, end in zip(stacks, ends.tolist(), strict=True):
        here, each = slice(end - len(stack.numbers), end), np.arange(len(stack.numbers))
        largest[here] = stack.signals[each, stack.products.diagonal(axis1=1, axis2=2).argmax(axis=1)]
        variances[here] = np.vecdot(stack.products, stack.products).sum(axis=1)
    remains = np.vecdot(largest, largest) - _held(effects, (effects.rows @ largest.T) ** 2)
    near = remains <= _ROUNDING * (1 - SAME_TERM**2) * seen
    return near & (effects.ranks.max(initial=0) * variances >= (SAME_TERM**2 / _ROUNDING * seen) ** 2)


def _held(effects: Blocks, squares: Float[np.ndarray, "rows processes"]) -> Float[np.ndarray, " processes"]:
    """The largest sum of squares along one of the effects, from those along the rows of all."""
    if not squares.size:
        return np.zeros(squares.shape[1])
    return np.add.reduceat(squares, np.cumsum(effects.ranks) - effects.ranks, axis=0).max(axis=0)


def _whole(at: Tangent, listed: Processes) -> Float[np.ndarray, " processes"]:
    """Sum of squares of each process's white signals."""
    kinds = listed.kinds
    if at.problem.correlated:
        each = (at.problem.rows(listed.process(k).signals) for k in range(len(kinds.kind)))
        return np.array([np.sum(rows**2) for rows in each])
    fields = ((listed.fields * at.whole_responses[:, :, None]) ** 2).sum(axis=1)
    each = fields.T @ (listed.components**2).sum(axis=1).T
    by_threes = each.reshape(-1, 3, each.shape[1]).sum(axis=1)
    alone = each[kinds.first_field, kinds.variable]
    return np.where(kinds.width == 1, alone, by_threes[kinds.first_field // 3, kinds.variable])
