"""All effects of the catalogue at once, given the data: the posterior of their coefficients.

With `S` the white signals of the coefficients at typical size, `U` an orthonormal basis of the residual space of the
parameters, `L = U' S` and `z = U' r` the residual there, the model is `z = L c + noise`, `c ~ N(0, diag(t^2))` (a Gaussian
linear model with random effects; Rasmussen and Williams, Gaussian Processes for Machine Learning, 2.7). Three unknowns are
summed over by their marginal likelihood (Carlin and Louis, Bayes and Empirical Bayes Methods for Data Analysis, 2000, 3.5):

- Which effects are named: the explanations `E` of the search, with their priors.
- The size `w` of the coefficients of the named effects, in typical sizes; its logarithm is flat. It is common to the
  coefficients of one effect: poorly determined or absorbed ones have the size of the others.
- The size `s`, in noise sd, that the visible signal of every other effect has. Its sd is bounded by the catalogue's
  typical size (1) and by `s`, `1 / t^2 = 1 + n^2 / s^2` (`n`: visible signal at typical size), since an effect that is
  much larger is found and named. A direction that the nominal model absorbs has the median of the others. Every sensor follows
  the temperature to first order, so these coefficients have at least 0.3 of their typical size.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import erfc, ndtri

from tumblecal.ground.showing import brief


# Scales `s` (noise sd) and their prior weights; the first is that of no undetected effect. (benchmarks/undetected_coverage.py)
SCALES = (0.0, 0.6, 1.0, 2.0, 5.0, 20.0)
WEIGHTS = (5.0, 2.0, 4.0, 3.0, 2.0, 1.0)
# Sizes `w` (typical sizes): from below to far above all effects that are met.
_NAMED = np.geomspace(0.3, 300.0, 16)
_LEAST_TEMPERATURE = 0.3
# What is less probable adds nothing.
_NEGLIGIBLE = 3e-4
# Share of the draws outside the interval that is stated of directions without a signal.
_OUTSIDE = 0.05


class Candidate(NamedTuple):
    """An explanation: the visible directions of its effects, the other directions with the same assumed size, and its log
    prior."""

    __repr__ = brief

    named: Bool[np.ndarray, " directions"]
    of_same_size: Bool[np.ndarray, " directions"]
    log_prior: float


class EffectPosterior(NamedTuple):
    """The coefficients (in typical sizes) given the data: their `mean`, and the mean of their products, `second`."""

    __repr__ = brief

    mean: Float[np.ndarray, " directions"]
    second: Float[np.ndarray, "directions directions"]


class _Background(NamedTuple):
    """The effects that are not named, of one scale: variances `t^2`, `L' K^-1 L` and `L' K^-1 z` with `K = 1 + L t^2 L'`, the
    residual's square `z' K^-1 z`, and half of the log determinant of `K`."""

    variances: Float[np.ndarray, " directions"]
    inner: Float[np.ndarray, "directions directions"]
    towards: Float[np.ndarray, " directions"]
    square: float
    half_log_det: float


class _Named(NamedTuple):
    """One candidate, given one background: eigenvectors of the named block of `inner`, the residual along them, the variance
    that each size `w` leaves of each, and the log evidence of each size."""

    axes: Float[np.ndarray, "named named"]
    along: Float[np.ndarray, " named"]
    left: Float[np.ndarray, "sizes named"]
    log_evidence: Float[np.ndarray, " sizes"]


def effect_posterior(
    signals: Float[np.ndarray, "nu directions"],
    z: Float[np.ndarray, " nu"],
    shown: Bool[np.ndarray, " directions"],
    always: Bool[np.ndarray, " directions"],
    candidates: Sequence[Candidate],
    *,
    known: bool,
) -> EffectPosterior:
    """The posterior of all coefficients.

    **Arguments:**

    - `signals`, `z`: `L` and `z`, in noise sd. `shown`: which directions the residuals can show; `always`: those that
      every sensor has.
    - `known`: whether the noise sd is known; otherwise it is integrated out by the likelihood's power of the sum of squares.
    """
    backgrounds = [_background(signals, z, shown, always, scale) for scale in SCALES]
    least = 1e-12 * float(z @ z) + 1e-300
    named = [
        [_with_named(background, candidate, len(z), least, known=known) for candidate in candidates]
        for background in backgrounds
    ]
    scores = np.full((len(SCALES), len(candidates), len(_NAMED)), -np.inf)
    for number, beside in enumerate(named):
        for place, own in enumerate(beside):
            scores[number, place, : len(own.log_evidence)] = own.log_evidence + np.log(WEIGHTS[number])
    weights = np.exp(scores - np.max(scores))
    weights /= np.sum(weights)
    mean, second = np.zeros(len(shown)), np.zeros((len(shown), len(shown)))
    absorbed = np.zeros((len(shown), len(_NAMED)))
    for number, background in enumerate(backgrounds):
        share, alone = float(np.sum(weights[number])), background.variances * background.towards
        if share < _NEGLIGIBLE:
            continue
        parts = [
            _moments(background, candidates[place], own, weights[number, place, : len(own.log_evidence)])
            for place, own in enumerate(named[number])
            if np.sum(weights[number, place]) > _NEGLIGIBLE
        ]
        further = sum((part[0] for part in parts), np.zeros(len(shown)))
        roots = np.hstack([np.zeros((len(shown), 0)), *(part[1] for part in parts)])
        mean += share * alone + further
        crossed = np.outer(alone, 0.5 * share * alone + further)
        second += crossed + crossed.T + roots @ roots.T
        second -= share * background.variances[:, None] * background.inner * background.variances
        second[np.diag_indices(len(shown))] += share * background.variances
    sizes = weights.sum(axis=0)
    for place, candidate in enumerate(candidates):
        absorbed[candidate.of_same_size] += sizes[place]
    hidden = np.flatnonzero(absorbed.any(axis=1))
    # Their signals are absorbed: the data say of them what they say of the size.
    second[hidden, hidden] += _equal_interval(absorbed[hidden]) ** 2
    return EffectPosterior(mean, second)


def _background(
    signals: Float[np.ndarray, "nu directions"],
    z: Float[np.ndarray, " nu"],
    shown: Bool[np.ndarray, " directions"],
    always: Bool[np.ndarray, " directions"],
    scale: float,
) -> _Background:
    visible = np.linalg.norm(signals, axis=0)
    sd = scale / np.hypot(scale, visible) if scale else np.zeros(len(visible))
    sd[~shown] = np.median(sd[shown]) if np.any(shown) else 0.0
    sd[always] = np.maximum(sd[always], _LEAST_TEMPERATURE)
    drawn = signals * sd
    root = np.linalg.cholesky(np.eye(len(z)) + drawn @ drawn.T)
    solved = np.linalg.solve(root, np.column_stack([signals, z]))
    rows, rest = solved[:, :-1], solved[:, -1]
    half_log_det = float(np.sum(np.log(np.diag(root))))
    return _Background(sd**2, rows.T @ rows, rows.T @ rest, float(rest @ rest), half_log_det)


def _with_named(background: _Background, candidate: Candidate, dof: int, least: float, *, known: bool) -> _Named:
    own = candidate.named
    variances, axes = np.linalg.eigh(background.inner[np.ix_(own, own)])
    along = axes.T @ background.towards[own]
    sizes = _NAMED[:, None] ** 2 if np.any(own) else np.zeros((1, 1))
    left = sizes / (1.0 + sizes * np.maximum(variances, 0.0))
    square = background.square - left @ along**2
    likelihood = -0.5 * square if known else -0.5 * dof * np.log(np.maximum(square, least))
    widths = 0.5 * np.sum(np.log1p(sizes * np.maximum(variances, 0.0)), axis=1)
    prior = candidate.log_prior - np.log(len(sizes))
    return _Named(axes, along, left, prior + likelihood - widths - background.half_log_det)


def _moments(
    background: _Background, candidate: Candidate, named: _Named, share: Float[np.ndarray, " sizes"]
) -> tuple[Float[np.ndarray, " directions"], Float[np.ndarray, "directions named"]]:
    """What named coefficients `x` beyond the background do to the mean of all coefficients, and a root of their mean products,
    by their share of the probability. The background is then what is expected of `z - L x`."""
    moved = -background.variances[:, None] * background.inner[:, candidate.named]
    moved[candidate.named] += np.eye(len(named.along))
    moved = moved @ named.axes
    sizes = named.left * named.along
    products = np.diag(share @ named.left) + (sizes.T * share) @ sizes
    variances, turned = np.linalg.eigh(products)
    return moved @ (share @ sizes), moved @ (turned * np.sqrt(np.maximum(variances, 0.0)))


def _equal_interval(shares: Float[np.ndarray, "hidden sizes"]) -> Float[np.ndarray, " hidden"]:
    """The sd of the normal distribution about zero that has the 95 % interval of a mixture of some of the sizes `w`, by their
    probabilities; what is missing to 1 is at zero. The mixture's own mean square is that of its largest sizes."""
    ends = np.geomspace(1e-3, 4.0 * _NAMED[-1], 200)
    outside = shares @ erfc(ends / (np.sqrt(2.0) * _NAMED[:, None]))
    return np.array([np.interp(-_OUTSIDE, -own, ends) for own in outside]) / float(-ndtri(_OUTSIDE / 2))
