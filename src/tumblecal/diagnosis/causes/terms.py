"""Candidates whose signals are fields times factors: jumps at a position, and terms of causes that are not in the catalogue.

A field is an output, an angle of the head, or an angle of the mount; a factor is a function of the settings or of the measuring
order. A jump begins at a position. Generic terms have one coefficient: products of inputs, harmonics of the spindle angle (by
themselves, times inputs, or at one pitch setting), slow and sudden changes in measuring order, temperature, and small rotations
of the head that follow any of these. For an error that comes and goes, two jumps or several outlier positions explain more than
any of them: shapes, limited to a time or a range of spindle angles, have as many coefficients as they need, and each reduces
their evidence. Errors that vary smoothly over all data are `lack_of_fit`.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.cause import GENERIC, UNEXPLAINED, Cause, Kind
from tumblecal.diagnosis.causes.faults import log_weights
from tumblecal.diagnosis.causes.table import Pool
from tumblecal.diagnosis.priors import (
    GENERIC_TEST_WEIGHT,
    GENERIC_WEIGHT,
    LEAST_VISIBLE_TERM,
    SAME_TERM,
    SHAPE_TEST_WEIGHT,
    SHAPE_WEIGHT,
)
from tumblecal.effects import AXES
from tumblecal.effects.effect import elapsed
from tumblecal.full_model.tangent import Tangent


# Ids of permanent changes at some position; their descriptions are in effects/procedure.py.
JUMPS = ("bias_jump", "mount_slip")
HARMONICS = (1, 2, 3, 4)
HEAD_ANGLES = ("index angle", "pitch angle", "tilt across the pitch axis")
_STEP = "step from the"
_WAVES = {"sin": np.sin, "cos": np.cos}
# Which products of inputs, counted through all degrees, harmonics are taken times.
_TIMES_HARMONICS = (0, 1, 2, 3, 6, 8)
# Spindle angles where the triad may be turned, over so many rad about; knots of the time at one pitch setting.
_TURNS, _WIDTH, _KNOTS = 8, 0.5, 8
# Widths (shares of the time) of the stretches in which something comes and goes, and how many there are of each.
_STRETCHES = {0.06: 12, 0.18: 5}
# Fewer coefficients are no shape: generic terms have them.
_LEAST_RANK = 3

Factors = Float[np.ndarray, "candidates factors positions"]


class Products(NamedTuple):
    """Candidates of one kind, one for every product of a field and one of its factors: labels, words, and the nominal
    parameters that change with it."""

    labels: Sequence[str]
    words: Sequence[str]
    fields: Float[np.ndarray, "positions 3 fields"]
    factors: Factors
    lasting: tuple[str, ...] = ()

    def rows(self, at: Tangent, number: int) -> Float[np.ndarray, "rows products"]:
        """White rows of the signals of one candidate."""
        return at.problem.rows(products(self.fields, self.factors[number].T))

    def projected(self, at: Tangent) -> Float[np.ndarray, "candidates products nu"]:
        """The signals of all candidates in the residual space, as rows."""
        (count, factors, positions), signals = self.factors.shape, self.fields.shape[2]
        fields = self.fields.mT @ at.responses.transpose(1, 2, 0)
        seen = self.factors.reshape(-1, positions) @ fields.reshape(positions, -1)
        return seen.reshape(count, factors, signals, at.dof).swapaxes(1, 2).reshape(count, factors * signals, at.dof)

    def largest(self, at: Tangent) -> Float[np.ndarray, " candidates"]:
        """Norm of the largest of each candidate's white rows."""
        if at.problem.correlated:
            return np.array([np.linalg.norm(self.rows(at, k), axis=0).max() for k in range(len(self.factors))])
        squares = ((self.fields * at.whole_responses[:, :, None]) ** 2).sum(axis=1)
        return np.sqrt((self.factors**2 @ squares).max(axis=(1, 2)))

    def candidates(self, at: Tangent, kind: Kind, log_weights: tuple[float, float], least: int) -> Pool:
        """Those of which the residuals can show at least so many directions."""
        signals = self.projected(at)
        if signals.shape[1] == 1:
            values, turned = np.vecdot(signals, signals), np.ones((len(signals), 1, 1))
        else:
            values, turned = np.linalg.eigh(signals @ signals.mT)
        sizes = np.sqrt(np.maximum(values, 0.0))
        shown = sizes > np.maximum(LEAST_VISIBLE_TERM * self.largest(at), 1e-12)[:, None]
        # As many coefficients as are seen: of so few positions some of them are one.
        ranks = shown.sum(axis=1)
        own = np.flatnonzero(ranks >= least)
        blocks = turned[own].mT @ signals[own] / np.maximum(sizes[own], 1e-300)[:, :, None]

        def made(number: int, cause: Cause) -> Cause:
            rows = self.rows(at, number)
            if ranks[number] < rows.shape[1]:
                rows = rows @ turned[number][:, shown[number]]
            return cause._replace(terms=tuple(rows.T.copy()), words=self.words[number], lasting=self.lasting)

        numbers, owners = own.tolist(), np.repeat(np.arange(len(own)), ranks[own])
        labels = [self.labels[k] for k in numbers]
        return Pool.of_kind(kind, labels, log_weights, blocks[shown[own]], owners, made, numbers=numbers)


def products(
    signals: Float[np.ndarray, "positions 3 signals"], factors: Float[np.ndarray, "positions factors"]
) -> Float[np.ndarray, "positions 3 products"]:
    """Every signal times every factor."""
    return (signals[..., None] * factors[:, None, None]).reshape(len(signals), 3, -1)


def _ranks_in_time(at: Tangent) -> Int[np.ndarray, " positions"]:
    """Place of each position in the measuring order."""
    return np.argsort(np.argsort(at.problem.where.measuring_order, kind="stable"), kind="stable")


def jumps(at: Tangent) -> list[Pool]:
    """Candidates from each position on: another bias of one axis; another mount angle, until the triad is remounted."""
    where, model, rank = at.problem.where, at.model, _ranks_in_time(at)
    order = np.argsort(rank)[1:]
    after, names = rank >= np.arange(1, len(rank))[:, None], [at.problem.names[k] for k in order.tolist()]
    logs = log_weights(JUMPS[0], -float(np.log(len(AXES) * max(1, len(order)))))
    labels, outputs = [f"{JUMPS[0]}:{name}" for name in names], np.broadcast_to(np.eye(3), (len(rank), 3, 3))
    listed = [
        Products(
            labels, [f"{axis} axis"] * len(labels), outputs[:, :, k : k + 1], after[:, None] * 1.0, (f"bias_{axis}",)
        )
        for k, axis in enumerate(AXES)
    ]
    pools = [own.candidates(at, Kind.JUMP, logs, 1) for own in listed]
    leaves = [name.partition("@")[0] for name in model.names]
    angles = tuple(f"dtheta_{axis}" for axis in AXES)
    columns = [[k for k, name in enumerate(leaves) if name == angle] for angle in angles]
    if all(columns):
        mounting, labels = np.asarray(where.index("mount")), [f"{JUMPS[1]}:{name}" for name in names]
        turns = np.stack([at.evaluation.jacobian[:, :, own].sum(axis=2) for own in columns], axis=2)
        factors = (after & (mounting == mounting[order, None]))[:, None] * 1.0
        logs = log_weights(JUMPS[1], -float(np.log(max(1, len(order)))))
        slips = Products(labels, [""] * len(labels), turns, factors, angles)
        pools.append(slips.candidates(at, Kind.JUMP, logs, len(angles)))
    return pools


def generic_causes(at: Tangent, effects: Pool, numbers: tuple[int, ...] | None = None) -> tuple[Pool, tuple[int, ...]]:
    """The generic terms that the residuals can show and that no effect of the catalogue covers.

    **Arguments:**

    - `effects`: the candidates that are effects.
    - `numbers`: of the terms to use, as returned for the plan; if omitted, they are selected here.

    **Returns:** the candidates, and their numbers in the list of all terms.
    """
    named = _factors(at)
    names, factors = list(named), np.array(list(named.values()))
    fields = [*(f"output {axis}" for axis in AXES), *HEAD_ANGLES]
    probe = at.evaluation.jacobian[:, :, at.model.probe]
    signals = np.concatenate([np.broadcast_to(np.eye(3), probe.shape), probe], axis=2)
    # An unknown error of the head turns with the angles and the time, not the inputs; unknown attitudes take up any.
    turning = np.array(["u_" not in name and not at.model.hand_held for name in names], bool)
    pools, chosen, directions = list[Pool](), list[int](), np.zeros((0, at.dof))
    for field, words in enumerate(fields):
        own = np.flatnonzero(turning | (field < len(AXES)))
        if numbers is not None:
            own = own[np.isin(own + field * len(names), numbers)]
        described = [f"{words}: {names[k]}" for k in own.tolist()]
        every = Products([UNEXPLAINED] * len(own), described, signals[:, :, field : field + 1], factors[own][:, None])
        pool = every.candidates(at, GENERIC, (0.0, 0.0), 1)
        if numbers is None:
            steps = np.array([_STEP in described[k] for _, k in pool.makers], bool)
            kept = _distinct(pool.rows, steps, effects, directions)
            pool, directions = pool.only(kept), np.concatenate([directions, pool.rows[kept]])
            own = own[[k for _, k in pool.makers]]
        pools.append(pool)
        chosen += (own + field * len(names)).tolist()
    every = Pool.joined(pools, at.dof)
    weights = (
        np.full(every.size, np.log(weight / max(1, len(chosen)))) for weight in (GENERIC_WEIGHT, GENERIC_TEST_WEIGHT)
    )
    return replace(every, log_weights=next(weights), test_log_weights=next(weights)), tuple(chosen)


def _distinct(
    unit: Float[np.ndarray, "terms nu"],
    steps: Bool[np.ndarray, " terms"],
    effects: Pool,
    directions: Float[np.ndarray, "earlier nu"],
) -> Int[np.ndarray, " distinct"]:
    """Of some terms by their directions those that are neither an effect of the catalogue nor an earlier term.

    A step in time is none of the effects that can imitate it with several coefficients, one for each setting, say.
    """
    begin = np.flatnonzero(np.diff(effects.owners, prepend=-1))
    several = np.diff(begin, append=len(effects.owners))[:, None] > 1
    same = np.sqrt(np.add.reduceat((effects.rows @ unit.T) ** 2, begin)) > SAME_TERM
    covered = np.any(same & ~(steps & several), axis=0)
    covered |= np.any(np.abs(directions @ unit.T) > SAME_TERM, axis=0)
    later = np.triu(np.abs(unit @ unit.T) > SAME_TERM, 1)
    for number in np.flatnonzero(later.any(axis=1)).tolist():
        if not covered[number]:
            covered |= later[number]
    return np.flatnonzero(~covered)


def _factors(at: Tangent) -> dict[str, Float[np.ndarray, " positions"]]:
    """The factors of the generic terms by their names: products of inputs, harmonics, their products, what is of one group
    alone, what follows the time or the temperature."""
    inputs, where = np.asarray(at.evaluation.inputs), at.problem.where
    powers = {
        " ".join(f"u_{AXES[k]}^{axes.count(k)}" for k in sorted(set(axes))).replace("^1", ""): inputs[:, axes].prod(
            axis=1
        )
        for degree in (1, 2, 3, 4)
        for axes in combinations_with_replacement(range(3), degree)
    }
    alpha, listed = np.asarray(where.alpha), list(powers.items())
    waves = {
        f"{wave}({order if order > 1 else ''}alpha)": make(order * alpha)
        for order in HARMONICS
        for wave, make in _WAVES.items()
    }
    factors = dict(listed[3:]) | waves
    factors |= {f"{listed[k][0]} {name}": listed[k][1] * wave for k in _TIMES_HARMONICS for name, wave in waves.items()}
    for column, words in (("pitch", "at pitch setting"), ("run", "in run"), ("mount", "in mounting")):
        index, constant = np.asarray(where.index(column)), {"constant": np.ones(len(alpha))}
        groups, kinds = np.unique(index).tolist(), constant | (waves if column == "pitch" else {})
        for group in groups if len(groups) > 1 else ():
            factors |= {f"{kind} {words} {group + 1}": own * (index == group) for kind, own in kinds.items()}
    rank, count = _ranks_in_time(at), len(alpha)
    if where.time_s is not None and np.ptp(np.asarray(where.time_s)) > 0:
        # By each clock from its own first position on: over a pause of unknown length nothing is supposed.
        since = np.asarray(elapsed(where))
        time, rank = since / (np.max(since) or 1.0), np.argsort(np.argsort(where.time_s, kind="stable"))
    else:
        time, rank = np.linspace(0.0, 1.0, count), np.arange(count)
    factors |= {f"time^{power}": (2 * time - 1) ** power for power in (1, 2, 3)}
    swings = {f"({k} periods in time)": 2 * np.pi * time * k for k in HARMONICS}
    factors |= {wave + words: make(own) for words, own in swings.items() for wave, make in _WAVES.items()}
    for first in range(1, count):
        if first % max(1, count // 24) == 0:
            steps = inputs * (rank >= first)[:, None]
            factors |= {f"u_{axis} {_STEP} {first + 1}th position on": steps[:, k] for k, axis in enumerate(AXES)}
    if where.temperature_degc is not None:
        warmer = np.asarray(where.temperature_degc)
        factors |= {f"temperature^{power}": (warmer - warmer.mean()) ** power for power in (2, 3)}
    return factors


def shape_causes(at: Tangent) -> list[Pool]:
    """The shapes that the residuals can show: turns of the triad around spindle angles, and what comes and goes in time."""
    where, probe = at.problem.where, at.evaluation.jacobian[:, :, at.model.probe]
    alpha, beta, order = (np.asarray(own) for own in (where.alpha, where.beta, where.measuring_order))
    centres = 2 * np.pi * np.arange(_TURNS) / _TURNS
    near = np.exp(-0.5 * (np.angle(np.exp(1j * (alpha - centres[:, None]))) / _WIDTH) ** 2)
    near = np.stack([near, near * (beta - np.mean(beta))], axis=1)
    around = [f"a rotation of the triad near spindle angle {np.degrees(centre):g} deg" for centre in centres]
    pitch = np.asarray(where.index("pitch"))
    # Piecewise linear functions of the time at one setting, which lies between -1 and 1 there.
    settings = np.unique(pitch)
    within = np.stack([np.where(pitch == own, _scaled(order, pitch == own), np.inf) for own in settings])
    knots = np.linspace(-1.0, 1.0, _KNOTS)
    hats = np.maximum(1.0 - np.abs(within[:, None] - knots[:, None]) / (knots[1] - knots[0]), 0.0)
    stretches = [f"index angle: any sequence of positions at pitch setting {own + 1}" for own in settings]
    # The middle of each stretch of positions, its width, and the number of the position there.
    listed = [(float(middle), width) for width, many in _STRETCHES.items() for middle in np.linspace(-1.0, 1.0, many)]
    numbers = [round((middle + 1) / 2 * (len(order) - 1)) + 1 for middle, _ in listed]
    middles, widths = np.array(listed).T
    away = (_scaled(order, np.ones(len(order), bool)) - middles[:, None]) / (2 * widths[:, None])
    for_a_while = np.exp(-0.5 * away**2)[:, None] * np.stack([np.ones_like(away), away], axis=1)
    outputs = [f"the outputs near the {number}th position" for number in numbers]
    turns = [f"a rotation of the triad near the {number}th position" for number in numbers]
    of_outputs = np.broadcast_to(np.eye(3), (len(order), 3, 3))
    kinds = [
        (around, probe, near),
        (stretches, probe[:, :, :1], hats),
        (outputs, of_outputs, for_a_while),
        (turns, probe, for_a_while),
    ]
    share = -float(np.log(sum(len(words) for words, *_ in kinds)))
    weights = share + float(np.log(SHAPE_WEIGHT)), share + float(np.log(SHAPE_TEST_WEIGHT))
    # Unknown attitudes take up any turn.
    return [
        Products([UNEXPLAINED] * len(words), words, *made_of).candidates(at, GENERIC, weights, _LEAST_RANK)
        for words, *made_of in kinds
        if words is outputs or not at.model.hand_held
    ]


def _scaled(
    values: Float[np.ndarray, " positions"], here: Bool[np.ndarray, " positions"]
) -> Float[np.ndarray, " positions"]:
    """Values such that those `here` lie between -1 and 1."""
    low, high = values[here].min(), values[here].max()
    return 2 * (values - low) / max(high - low, 1e-12) - 1
