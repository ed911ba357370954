"""Processes in the residual space, those of equally many signals stacked."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.components import Components, Sizes, components_of, sizes_of
from tumblecal.diagnosis.processes import Processes
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import LEAST_VISIBLE_TERM, SAME_TERM


# Processes whose numbers of components differ by less are stacked with zeros beside them.
_PADDED = 4
_ROUNDING = 0.999


class Stack(NamedTuple):
    """Processes of equally many signals, by their `numbers` in the table of all.

    `signals` in the residual space, field after field; their `components`, and the `sizes` of the processes.
    """

    numbers: Int[np.ndarray, " processes"]
    signals: Float[np.ndarray, "processes nu signals"]
    components: Components
    sizes: Sizes

    def explained(self, z: Float[np.ndarray, "draws nu"]) -> Float[np.ndarray, "processes sizes draws"]:
        """What each process of each size explains of residual vectors."""
        return self.sizes.shares @ self.components.along(np.swapaxes(self.signals, 1, 2) @ z.T) ** 2

    def fitted(
        self, number: int, size: int, z: Float[np.ndarray, " nu"]
    ) -> tuple[Float[np.ndarray, "nu signals"], Float[np.ndarray, " signals"]]:
        """The signals of a process, and the coefficients that fit a residual vector best at one of the sizes."""
        row = int(np.flatnonzero(self.numbers == number)[0])
        signals, own = self.signals[row], self.components.only(np.array([row]))
        along = own.along((z @ signals)[None, :, None])[0, :, 0]
        return signals, own.mixed[0] @ (own.precisions[0] * self.sizes.shares[row, size] * along)


def stacked(at: Tangent, listed: Processes, effects: Sequence[Cause]) -> tuple[Stack, ...]:
    """The processes of which the residuals can show enough, and that are more than one of the effects."""
    factors, stacks = _side_by_side(listed), []
    whole, blocks = _whole(at, listed, factors), _Blocks.of(effects)
    for numbers, signals in _signals(at, listed, factors):
        seen = np.einsum("pvs,pvs->p", signals, signals)
        shown = seen > LEAST_VISIBLE_TERM**2 * whole[numbers]
        numbers, signals, seen = numbers[shown], signals[shown], seen[shown]
        components = components_of(signals)
        more = ~blocks.hold(signals, components.variances, seen)
        if np.any(more):
            components = components.only(more)
            stacks.append(Stack(numbers[more], signals[more], components, sizes_of(components.variances)))
    return tuple(stacks)


class _Factors(NamedTuple):
    """Components of all variables, padded with zeros, and their number."""

    components: Float[np.ndarray, "variables positions most"]
    counts: Int[np.ndarray, " variables"]


def _side_by_side(listed: Processes) -> _Factors:
    each = [variable.components for variable in listed.variables.values()]
    counts = np.array([len(own.T) for own in each])
    padded = np.zeros((len(each), len(listed.fields), -(-max(counts) // _PADDED) * _PADDED))
    for row, own in zip(padded, each, strict=True):
        row[:, : len(own.T)] = own
    return _Factors(padded, counts)


def _signals(
    at: Tangent, listed: Processes, factors: _Factors
) -> Iterator[tuple[Int[np.ndarray, " processes"], Float[np.ndarray, "processes nu signals"]]]:
    """The numbers of processes with equally many fields and about as many components, and their signals in the residual
    space."""
    fields = np.ascontiguousarray((at.responses.swapaxes(0, 1) @ listed.fields).transpose(2, 1, 0))
    counts = -(-factors.counts // _PADDED)[listed.variable] * _PADDED
    for width, count in sorted(set(zip(listed.width.tolist(), counts.tolist(), strict=True))):
        numbers = np.flatnonzero((listed.width == width) & (counts == count))
        own = factors.components[listed.variable[numbers], None, :, :count]
        signals = fields[listed.first_field[numbers][:, None] + np.arange(width)] @ own
        yield numbers, signals.swapaxes(1, 2).reshape(len(numbers), at.dof, width * count)


def _whole(at: Tangent, listed: Processes, factors: _Factors) -> Float[np.ndarray, " processes"]:
    """Sum of squares of each process's white signals."""
    if at.problem.correlated:
        each = (at.problem.rows(listed.process(k).signals) for k in range(len(listed.variable)))
        return np.array([np.sum(rows**2) for rows in each])
    fields = np.sum((listed.fields * at.whole_responses[:, :, None]) ** 2, axis=1)
    each = fields.T @ np.sum(factors.components**2, axis=2).T
    summed = np.concatenate([np.zeros((1, each.shape[1])), np.cumsum(each, axis=0)])
    return summed[listed.first_field + listed.width, listed.variable] - summed[listed.first_field, listed.variable]


class _Blocks(NamedTuple):
    """Orthonormal blocks of the effects side by side, those of the highest rank first."""

    columns: Float[np.ndarray, "columns nu"]
    ranks: Int[np.ndarray, " effects"]

    @classmethod
    def of(cls, effects: Sequence[Cause]) -> "_Blocks":
        each = sorted((cause.block.T for cause in effects if cause.block is not None), key=len, reverse=True)
        return cls(np.concatenate(each) if each else np.zeros((0, 0)), np.array([len(own) for own in each], int))

    def hold(
        self,
        signals: Float[np.ndarray, "processes nu signals"],
        variances: Float[np.ndarray, "processes signals"],
        seen: Float[np.ndarray, " processes"],
    ) -> Bool[np.ndarray, " processes"]:
        """Which processes have nearly all of their variance in what one of the effects can make."""
        held = np.zeros(len(seen), bool)
        # No block holds more than as many of the largest components as it has directions.
        carried = np.cumsum(variances[:, ::-1], axis=1)
        least = 1 + np.sum(carried < _ROUNDING * SAME_TERM**2 * seen[:, None], axis=1)
        for rank in sorted(set(least.tolist())):
            ranks = self.ranks[self.ranks >= rank]
            if not len(ranks):
                break
            near = np.flatnonzero(least == rank)
            squares = np.sum((self.columns[: np.sum(ranks)] @ signals[near]) ** 2, axis=2)
            by_effect = np.add.reduceat(squares, np.cumsum(ranks) - ranks, axis=1)
            held[near] = seen[near] <= np.max(by_effect, axis=1) / SAME_TERM**2
        return held
