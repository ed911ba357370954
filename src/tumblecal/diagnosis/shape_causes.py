"""Terms that are there for a while or around a spindle angle alone: what a pull, a stick or a gust looks like.

A generic term has one coefficient, and what comes and goes leaves to each of them so much that jumps there and back, or
several positions off, explain more. These have as many coefficients as the shape needs, and pay for each. What moves smoothly
over all of the data is `lack_of_fit`.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.generic_causes import Generic
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import LEAST_VISIBLE_TERM, SHAPE_TEST_WEIGHT, SHAPE_WEIGHT


# Spindle angles where the triad may be turned, over so many rad about; knots of the time at one pitch setting.
_TURNS, _WIDTH, _KNOTS = 8, 0.5, 8
# Widths (shares of the time) of the stretches in which something comes and goes, and how many there are of each.
_STRETCHES = {0.06: 12, 0.18: 5}
# Fewer coefficients are no shape: generic terms have them.
_LEAST_RANK = 3


def shape_causes(at: Tangent) -> list[Cause]:
    """The shapes that the residuals can show."""
    every, causes = list(_shapes(at)), list[Cause]()
    share = -float(np.log(len(every)))
    weights = share + float(np.log(SHAPE_WEIGHT)), share + float(np.log(SHAPE_TEST_WEIGHT))
    # Unknown attitudes take up any turn.
    shapes = [(words, products(*made)) for words, turns, *made in every if not (turns and at.model.hand_held)]
    of_all = at.problem.rows(np.concatenate([signals for _, signals in shapes], axis=2))
    projected = at.basis[: len(of_all)].T @ of_all
    last = np.cumsum([signals.shape[2] for _, signals in shapes])[:-1]
    for (words, _), rows, seen in zip(shapes, np.hsplit(of_all, last), np.hsplit(projected, last), strict=True):
        left, singular, right = np.linalg.svd(seen, full_matrices=False)
        shown = singular > LEAST_VISIBLE_TERM * np.max(np.linalg.norm(rows, axis=0))
        if np.sum(shown) >= _LEAST_RANK:
            # As many coefficients as are seen: of so few positions some of them are one.
            causes.append(Generic(*weights, left[:, shown], tuple((rows @ right[shown].T).T), words))
    return causes


def _shapes(
    at: Tangent,
) -> Iterator[tuple[str, bool, Float[np.ndarray, "positions 3 signals"], Float[np.ndarray, "positions factors"]]]:
    """Words, whether the triad is turned, and the signals and factors whose products the shape is made of."""
    where, probe = at.problem.where, at.evaluation.jacobian[:, :, at.model.probe]
    alpha, beta, order = np.asarray(where.alpha), np.asarray(where.beta), where.measuring_order
    time = _scaled(order, np.ones(len(order), bool))
    for centre in 2 * np.pi * np.arange(_TURNS) / _TURNS:
        near = np.exp(-0.5 * (np.angle(np.exp(1j * (alpha - centre))) / _WIDTH) ** 2)
        by_pitch = np.stack([near, near * (beta - beta.mean())], axis=1)
        yield f"a turn of the triad around spindle angle {np.degrees(centre):g} deg", True, probe, by_pitch
    pitch = np.asarray(where.index("pitch"))
    for setting in np.unique(pitch):
        within = np.where(pitch == setting, _scaled(order, pitch == setting), np.inf)
        hats = _hats(within)
        yield f"index angle: any stretch of positions at pitch setting {setting + 1}", True, probe[:, :, :1], hats
    outputs = np.broadcast_to(np.eye(3), (len(alpha), 3, 3))
    for width, count in _STRETCHES.items():
        for centre in np.linspace(-1.0, 1.0, count):
            away = (time - centre) / (2 * width)
            near = np.exp(-0.5 * away**2)[:, None] * np.stack([np.ones_like(away), away], axis=1)
            position = round((centre + 1) / 2 * (len(alpha) - 1)) + 1
            yield f"the outputs around the {position}th position", False, outputs, near
            yield f"a turn of the triad around the {position}th position", True, probe, near


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
