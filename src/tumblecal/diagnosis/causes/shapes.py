"""Terms limited to a time or a range of spindle angles: the signals of a pull, a stick or a gust.

A generic term has one coefficient. For an error that comes and goes, two jumps or several outlier positions explain more than
any of them. A shape has as many coefficients as it needs, and each reduces its evidence. Errors that vary smoothly over all
data are `lack_of_fit`.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.generic import GENERIC, UNEXPLAINED
from tumblecal.diagnosis.causes.table import CauseTable, equally_weighted
from tumblecal.diagnosis.priors import LEAST_VISIBLE_TERM, SHAPE_TEST_WEIGHT, SHAPE_WEIGHT
from tumblecal.full_model.tangent import Tangent


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
    factors: Float[np.ndarray, "shapes factors positions"]

    @property
    def width(self) -> int:
        """Number of products of each."""
        return self.signals * self.factors.shape[1]

    def signals_at(self, at: Tangent) -> Float[np.ndarray, "positions 3 signals"]:
        """Signals that the factors multiply."""
        probe = at.evaluation.jacobian[:, :, at.model.probe]
        return probe[:, :, : self.signals] if self.turns else np.broadcast_to(np.eye(3), (len(probe), 3, 3))

    def rows(self, at: Tangent, number: int) -> Float[np.ndarray, "rows products"]:
        """White rows of the signals of one shape."""
        return at.problem.rows(products(self.signals_at(at), self.factors[number].T))

    def projected(self, made_of: "_Signals") -> Float[np.ndarray, "shapes products nu"]:
        """The signals of all shapes in the residual space, as rows."""
        shapes, factors, count = self.factors.shape
        fields = (made_of.turns if self.turns else made_of.outputs)[:, : self.signals]
        seen = self.factors.reshape(-1, count) @ fields.reshape(count, -1)
        return seen.reshape(shapes, factors, self.signals, -1).swapaxes(1, 2).reshape(shapes, self.width, -1)

    def largest(self, at: Tangent, made_of: "_Signals") -> Float[np.ndarray, " shapes"]:
        """Norm of the largest of each one's rows before the projection."""
        if at.problem.correlated:
            return np.array([np.linalg.norm(self.rows(at, k), axis=0).max() for k in range(len(self.words))])
        squares = made_of.turn_squares if self.turns else made_of.output_squares
        return np.sqrt((self.factors**2 @ squares[:, : self.signals]).max(axis=(1, 2)))


class _Signals(NamedTuple):
    """What the shapes of one problem are made of: in the residual space the outputs, and turns by the head's angles, and the
    squares of their white sizes."""

    outputs: Float[np.ndarray, "positions 3 nu"]
    turns: Float[np.ndarray, "positions 3 nu"]
    output_squares: Float[np.ndarray, "positions 3"]
    turn_squares: Float[np.ndarray, "positions 3"]

    @classmethod
    def of(cls, at: Tangent) -> "_Signals":
        """The signals of a problem."""
        outputs, probe = at.responses.transpose(1, 2, 0), at.evaluation.jacobian[:, :, at.model.probe]
        squares = at.whole_responses**2
        return cls(outputs, probe.mT @ outputs, squares, (probe**2 * squares[:, :, None]).sum(axis=1))


def shape_causes(at: Tangent) -> list[CauseTable]:
    """The shapes that the residuals can show."""
    where = at.problem.where
    alpha, beta = (tuple(np.asarray(angle).tolist()) for angle in (where.alpha, where.beta))
    every = [_around(alpha, beta), *_in_time(where.measuring_order, np.asarray(where.index("pitch")))]
    share = -float(np.log(sum(len(kind.words) for kind in every)))
    weights = share + float(np.log(SHAPE_WEIGHT)), share + float(np.log(SHAPE_TEST_WEIGHT))
    # Unknown attitudes take up any turn.
    kinds = [kind for kind in every if not (kind.turns and at.model.hand_held)]
    widths, made_of = dict.fromkeys([kind.width for kind in kinds]), _Signals.of(at)
    return [_visible(at, made_of, [kind for kind in kinds if kind.width == width], weights) for width in widths]


def _visible(at: Tangent, made_of: _Signals, kinds: list[_Shapes], log_weights: tuple[float, float]) -> CauseTable:
    """Shapes of some kinds, made of equally many products, that the residuals can show."""
    seen = np.concatenate([kind.projected(made_of) for kind in kinds])
    values, vectors = np.linalg.eigh(seen @ seen.mT)
    # The largest first.
    singular, vectors = np.sqrt(np.maximum(values[:, ::-1], 0.0)), vectors[:, :, ::-1]
    largest = np.concatenate([kind.largest(at, made_of) for kind in kinds])
    # As many coefficients as are seen: of so few positions some of them are one.
    ranks = (singular > LEAST_VISIBLE_TERM * largest[:, None]).sum(axis=1)
    numbers = np.flatnonzero(ranks >= _LEAST_RANK)
    ranks, vectors = ranks[numbers], vectors[numbers]
    blocks = vectors.mT @ seen[numbers] / np.maximum(singular[numbers], 1e-300)[:, :, None]
    listed = [(kind, number) for kind in kinds for number in range(len(kind.words))]
    own = [listed[number] for number in numbers.tolist()]

    def shape(k: int, label: str, weights: tuple[float, float], block: np.ndarray) -> Cause:
        kind, number = own[k]
        terms = tuple((kind.rows(at, number) @ vectors[k, :, : ranks[k]]).T)
        return Cause(GENERIC, label, *weights, block, terms=terms, words=kind.words[number])

    shown, owners = np.arange(blocks.shape[1]) < ranks[:, None], np.repeat(np.arange(len(own)), ranks)
    return equally_weighted(GENERIC, [UNEXPLAINED] * len(own), log_weights, blocks[shown], owners, shape)


@lru_cache(maxsize=64)
def _around(alpha: tuple[float, ...], beta: tuple[float, ...]) -> _Shapes:
    """Turns of the triad around spindle angles."""
    centres = 2 * np.pi * np.arange(_TURNS) / _TURNS
    near = np.exp(-0.5 * (np.angle(np.exp(1j * (np.array(alpha) - centres[:, None]))) / _WIDTH) ** 2)
    words = [f"a rotation of the triad near spindle angle {np.degrees(centre):g} deg" for centre in centres]
    return _Shapes(words, True, 3, np.stack([near, near * (np.array(beta) - np.mean(beta))], axis=1))


def _in_time(order: Float[np.ndarray, " positions"], pitch: Int[np.ndarray, " positions"]) -> list[_Shapes]:
    """What comes and goes in time; `order`: the time of each position in the measuring order, `pitch`: its setting."""
    here = pitch == np.unique(pitch)[:, None]
    within = np.stack([np.where(own, _scaled(order, own), np.inf) for own in here])
    stretches = [f"index angle: any sequence of positions at pitch setting {own + 1}" for own in np.unique(pitch)]
    # The middle of each stretch of positions, its width, and the number of the position there.
    listed = [(float(middle), width) for width, many in _STRETCHES.items() for middle in np.linspace(-1.0, 1.0, many)]
    numbers = [round((middle + 1) / 2 * (len(order) - 1)) + 1 for middle, _ in listed]
    middles, widths = np.array(listed).T
    away = (_scaled(order, np.ones(len(order), bool)) - middles[:, None]) / (2 * widths[:, None])
    for_a_while = np.exp(-0.5 * away**2)[:, None] * np.stack([np.ones_like(away), away], axis=1)
    # Piecewise linear functions of what lies between -1 and 1.
    knots = np.linspace(-1.0, 1.0, _KNOTS)
    hats = np.maximum(1.0 - np.abs(within[..., None] - knots) / (knots[1] - knots[0]), 0.0)
    return [
        _Shapes(stretches, True, 1, hats.swapaxes(1, 2)),
        _Shapes([f"the outputs near the {number}th position" for number in numbers], False, 3, for_a_while),
        _Shapes([f"a rotation of the triad near the {number}th position" for number in numbers], True, 3, for_a_while),
    ]


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
