"""Terms that take any shape along the spindle angle, an input or the time: what a bump, a knee, a pull or a gust looks like.

A generic term has one coefficient, and a cause of another shape leaves to each of them so much that a named effect of nearly
its shape explains more. These have as many coefficients as the shape needs, and pay for each.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.generic_causes import HEAD_ANGLES, Generic
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import LEAST_VISIBLE_TERM, SHAPE_TEST_WEIGHT, SHAPE_WEIGHT
from tumblecal.effects import AXES


# Harmonics of the spindle angle that make up any function of it, those of one that grows with time, knots of an input, and
# spindle angles where the triad may be turned, over so many rad about.
_HARMONICS, _IN_TIME, _KNOTS, _TURNS, _WIDTH = 5, 3, 8, 8, 0.5
# Widths (shares of the time) of the stretches in which something comes and goes, and how many there are of each.
_STRETCHES = {0.06: 12, 0.18: 5}
# Fewer coefficients are no shape: generic terms have them.
_LEAST_RANK = 3


def shape_causes(at: Tangent) -> list[Cause]:
    """The shapes that the residuals can show."""
    shapes, causes = list(_shapes(at)), list[Cause]()
    share = -float(np.log(len(shapes)))
    weights = share + float(np.log(SHAPE_WEIGHT)), share + float(np.log(SHAPE_TEST_WEIGHT))
    for words, signals in shapes:
        rows = at.problem.rows(signals)
        left, singular, right = np.linalg.svd(at.basis[: len(rows)].T @ rows, full_matrices=False)
        shown = singular > LEAST_VISIBLE_TERM * np.max(np.linalg.norm(rows, axis=0))
        if np.sum(shown) >= _LEAST_RANK:
            # As many coefficients as are seen: at so few angles some harmonics are one.
            causes.append(Generic(*weights, left[:, shown], tuple((rows @ right[shown].T).T), words))
    return causes


def _shapes(at: Tangent) -> Iterator[tuple[str, Float[np.ndarray, "positions 3 coefficients"]]]:
    """Words and signals."""
    where, probe = at.problem.where, at.evaluation.jacobian[:, :, at.model.probe]
    alpha, order = np.asarray(where.alpha), where.measuring_order
    time = _scaled(order, np.ones(len(order), bool))
    waves, few = _waves(alpha, _HARMONICS), _waves(alpha, _IN_TIME)
    for k, name in enumerate(HEAD_ANGLES):
        yield f"{name}: any function of the spindle angle", probe[:, :, k, None] * waves[:, None]
    beta = np.asarray(where.beta)
    for centre in 2 * np.pi * np.arange(_TURNS) / _TURNS:
        near = np.exp(-0.5 * (np.angle(np.exp(1j * (alpha - centre))) / _WIDTH) ** 2)
        by_pitch = np.stack([near, near * (beta - beta.mean())], axis=1)
        yield f"a turn of the triad around spindle angle {np.degrees(centre):g} deg", _times(probe, by_pitch)
    pitch = np.asarray(where.index("pitch"))
    for setting in np.unique(pitch):
        within = np.where(pitch == setting, _scaled(order, pitch == setting), np.inf)
        stretches = probe[:, :, 0, None] * _hats(within)[:, None]
        yield f"index angle: any stretch of positions at pitch setting {setting + 1}", stretches
    for k, axis in enumerate(AXES):
        yield f"output {axis}: any function of the spindle angle", _on_output(k, waves)
        yield (
            f"output {axis}: any function of the spindle angle that grows with time",
            _on_output(k, few * time[:, None]),
        )
        for other, name in enumerate(AXES):
            yield f"output {axis}: any function of input {name}", _on_output(k, _hats(at.evaluation.inputs[:, other]))
    outputs = np.broadcast_to(np.eye(3), (len(alpha), 3, 3))
    for width, count in _STRETCHES.items():
        for centre in np.linspace(-1.0, 1.0, count):
            away = (time - centre) / (2 * width)
            near = np.exp(-0.5 * away**2)[:, None] * np.stack([np.ones_like(away), away], axis=1)
            position = round((centre + 1) / 2 * (len(alpha) - 1)) + 1
            yield f"the outputs around the {position}th position", _times(outputs, near)
            yield f"a turn of the triad around the {position}th position", _times(probe, near)


def _waves(alpha: Float[np.ndarray, " positions"], most: int) -> Float[np.ndarray, "positions waves"]:
    turns = np.arange(1, most + 1) * alpha[:, None]
    return np.hstack([np.ones((len(alpha), 1)), np.cos(turns), np.sin(turns)])


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


def _times(
    signals: Float[np.ndarray, "positions 3 signals"], factors: Float[np.ndarray, "positions factors"]
) -> Float[np.ndarray, "positions 3 products"]:
    return (signals[..., None] * factors[:, None, None]).reshape(len(signals), 3, -1)


def _on_output(axis: int, values: Float[np.ndarray, "positions terms"]) -> Float[np.ndarray, "positions 3 terms"]:
    signals = np.zeros((len(values), 3, values.shape[1]))
    signals[:, axis] = values
    return signals
