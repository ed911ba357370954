"""Terms that are there for a while or around a spindle angle alone: what a pull, a stick or a gust looks like.

A generic term has one coefficient, and what comes and goes leaves to each of them so much that jumps there and back, or
several positions off, explain more. These have as many coefficients as the shape needs, and pay for each. What moves smoothly
over all of the data is `lack_of_fit`.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.cause_table import CauseTable, alike
from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.generic_causes import UNEXPLAINED, Generic
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import LEAST_VISIBLE_TERM, SHAPE_TEST_WEIGHT, SHAPE_WEIGHT


# Spindle angles where the triad may be turned, over so many rad about; knots of the time at one pitch setting.
_TURNS, _WIDTH, _KNOTS = 8, 0.5, 8
# Widths (shares of the time) of the stretches in which something comes and goes, and how many there are of each.
_STRETCHES = {0.06: 12, 0.18: 5}
# Fewer coefficients are no shape: generic terms have them.
_LEAST_RANK = 3


class _Shapes(NamedTuple):
    """Shapes of one kind: their words, whether the triad is turned, and the factors of each, whose products with signals the
    shape is made of: with the head's angles from the first on, `signals` of them, or with the outputs."""

    words: list[str]
    turns: bool
    signals: int
    factors: Float[np.ndarray, "shapes positions factors"]


def shape_causes(at: Tangent) -> list[CauseTable]:
    """The shapes that the residuals can show."""
    where = at.problem.where
    columns = (where.alpha, where.beta, where.index("pitch"), where.measuring_order)
    every = _shapes(*(tuple(np.asarray(column).tolist()) for column in columns))
    share = -float(np.log(sum(len(kind.words) for kind in every)))
    weights = share + float(np.log(SHAPE_WEIGHT)), share + float(np.log(SHAPE_TEST_WEIGHT))
    # Unknown attitudes take up any turn.
    return [_visible(at, kind, weights) for kind in every if not (kind.turns and at.model.hand_held)]


def _visible(at: Tangent, kind: _Shapes, log_weights: tuple[float, float]) -> CauseTable:
    """Those of one kind that the residuals can show."""
    count, shapes = len(at.evaluation.inputs), len(kind.words)
    signals = at.evaluation.jacobian[:, :, at.model.probe][:, :, : kind.signals]
    signals = signals if kind.turns else np.broadcast_to(np.eye(3), (count, 3, 3))
    made = signals[:, :, None, :, None] * np.swapaxes(kind.factors, 0, 1)[:, None, :, None, :]
    white = at.problem.rows(made.reshape(count, 3, -1))
    rows = np.moveaxis(white.reshape(len(white), shapes, -1), 0, 1)
    seen = (white.T @ at.basis[: len(white)]).reshape(shapes, -1, at.dof)
    values, vectors = np.linalg.eigh(seen @ np.swapaxes(seen, 1, 2))
    # The largest first.
    singular, vectors = np.sqrt(np.maximum(values[:, ::-1], 0.0)), vectors[:, :, ::-1]
    shown = singular > LEAST_VISIBLE_TERM * np.sqrt(np.max(np.sum(rows**2, axis=1), axis=1))[:, None]
    # As many coefficients as are seen: of so few positions some of them are one.
    ranks = np.sum(shown, axis=1)
    numbers = np.flatnonzero(ranks >= _LEAST_RANK)
    own, ranks, vectors = numbers.tolist(), ranks[numbers], vectors[numbers]
    blocks = np.swapaxes(vectors, 1, 2) @ seen[numbers] / np.maximum(singular[numbers], 1e-300)[:, :, None]
    taken = np.arange(blocks.shape[1]) < ranks[:, None]

    def shape(k: int, label: str, weights: tuple[float, float], block: np.ndarray) -> Cause:
        terms = (rows[own[k]] @ vectors[k, :, : ranks[k]]).T
        return Generic(*weights, block, tuple(terms), kind.words[own[k]])

    owners = np.repeat(np.arange(len(own)), ranks)
    return alike(Generic, [UNEXPLAINED] * len(own), log_weights, blocks[taken], owners, shape)


@lru_cache(maxsize=64)
def _shapes(
    alpha: tuple[float, ...], beta: tuple[float, ...], pitch: tuple[int, ...], order: tuple[float, ...]
) -> tuple[_Shapes, ...]:
    """The shapes of a plan by kind; `pitch`: the setting of each position, `order`: its time in the measuring order."""
    leaning, time = np.array(beta) - np.mean(beta), _scaled(np.array(order), np.ones(len(order), bool))
    centres = 2 * np.pi * np.arange(_TURNS) / _TURNS
    near = np.exp(-0.5 * (np.angle(np.exp(1j * (np.array(alpha) - centres[:, None]))) / _WIDTH) ** 2)
    around = [f"a turn of the triad around spindle angle {np.degrees(centre):g} deg" for centre in centres]
    within = [
        np.where(np.array(pitch) == own, _scaled(np.array(order), np.array(pitch) == own), np.inf)
        for own in sorted(set(pitch))
    ]
    stretches = [f"index angle: any stretch of positions at pitch setting {own + 1}" for own in sorted(set(pitch))]
    middles = [(width, middle) for width, count in _STRETCHES.items() for middle in np.linspace(-1.0, 1.0, count)]
    away = np.stack([(time - middle) / (2 * width) for width, middle in middles])
    for_a_while = np.exp(-0.5 * away**2)[:, :, None] * np.stack([np.ones_like(away), away], axis=2)
    numbers = [round((middle + 1) / 2 * (len(alpha) - 1)) + 1 for _, middle in middles]
    return (
        _Shapes(around, True, 3, np.stack([near, near * leaning], axis=2)),
        _Shapes(stretches, True, 1, np.stack([_hats(own) for own in within])),
        _Shapes([f"the outputs around the {number}th position" for number in numbers], False, 3, for_a_while),
        _Shapes([f"a turn of the triad around the {number}th position" for number in numbers], True, 3, for_a_while),
    )


def products(
    signals: Float[np.ndarray, "positions 3 signals"], factors: Float[np.ndarray, "positions factors"]
) -> Float[np.ndarray, "positions 3 products"]:
    """Every signal times every factor."""
    return (signals[..., None] * factors[:, None, None]).reshape(len(signals), 3, -1)


def _scaled(
    values: Float[np.ndarray, " positions"], here: Bool[np.ndarray, " positions"]
) -> Float[np.ndarray, " positions"]:
    """Values such that those `here` lie between -1 and 1."""
    low, high = values[here].min(), values[here].max()
    return 2 * (values - low) / max(high - low, 1e-12) - 1


def _hats(values: Float[np.ndarray, " positions"]) -> Float[np.ndarray, "positions knots"]:
    """Piecewise linear functions of what lies between -1 and 1."""
    knots = np.linspace(-1.0, 1.0, _KNOTS)
    return np.clip(1.0 - np.abs(values[:, None] - knots) / (knots[1] - knots[0]), 0.0, 1.0)
