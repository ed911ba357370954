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

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg.lapack import dpotrf, dtrtrs  # type: ignore[attr-defined]
from scipy.special import erfc, ndtri

from tumblecal.full_model.priors import LEAST_TEMPERATURE_EFFECT, NAMED_SIZES, UNDETECTED_SIZES, UNDETECTED_WEIGHTS
from tumblecal.ground.showing import brief


# The sizes `w` of named effects.
_NAMED = np.geomspace(*NAMED_SIZES)
# Less probable explanations add nothing.
_NEGLIGIBLE = 3e-4
# Share of the draws outside the interval that is stated of directions without a signal.
_OUTSIDE = 0.05


class Candidates(NamedTuple):
    """Explanations: the visible directions of the effects of each, the other directions with the same assumed size, and its
    log prior."""

    __repr__ = brief

    named: Bool[np.ndarray, "candidates directions"]
    of_same_size: Bool[np.ndarray, "candidates directions"]
    log_prior: Float[np.ndarray, " candidates"]


class EffectPosterior(NamedTuple):
    """The coefficients (in typical sizes) given the data: their `mean`, and the mean of their products, `second`."""

    __repr__ = brief

    mean: Float[np.ndarray, " directions"]
    second: Float[np.ndarray, "directions directions"]


class _Background(NamedTuple):
    """The effects that are not named, of one scale: variances `t^2`, `K^-1/2 L` and `L' K^-1 z` with `K = 1 + L t^2 L'`, the
    residual's square `z' K^-1 z`, and half of the log determinant of `K`."""

    variances: Float[np.ndarray, " directions"]
    white: Float[np.ndarray, "nu directions"]
    towards: Float[np.ndarray, " directions"]
    square: float
    half_log_det: float


class _OfOneRank(NamedTuple):
    """The candidates with equally many named directions, `columns`, for each background: eigenvectors `axes` of the named
    block of `L' K^-1 L`, the residual along them, and the variance that each size `w` leaves of each."""

    numbers: Int[np.ndarray, " candidates"]
    columns: Int[np.ndarray, "candidates named"]
    axes: Float[np.ndarray, "scales candidates named named"]
    along: Float[np.ndarray, "scales candidates named"]
    variances: Float[np.ndarray, "scales candidates sizes named"]


def effect_posterior(
    signals: Float[np.ndarray, "rows directions"],
    z: Float[np.ndarray, " rows"],
    shown: Bool[np.ndarray, " directions"],
    always: Bool[np.ndarray, " directions"],
    candidates: Candidates,
    *,
    dof: int,
    known: bool,
) -> EffectPosterior:
    """The posterior of all coefficients.

    **Arguments:**

    - `signals`, `z`: `L` and `z`, in noise sd, as rows of `dof` dimensions. `shown`: which directions the residuals can show;
      `always`: those that every sensor has.
    - `known`: whether the noise sd is known; otherwise it is integrated out by the likelihood's power of the sum of squares.
    """
    if len(z) > signals.shape[1] + 1:
        # Only their products with each other count.
        rows = np.asarray(np.linalg.qr(np.column_stack([signals, z]), mode="r"))
        signals, z = rows[:, :-1], rows[:, -1]
    backgrounds = [_background(signals, z, shown, always, scale) for scale in UNDETECTED_SIZES]
    scores, groups = _scored(backgrounds, candidates, dof, 1e-12 * float(z @ z) + 1e-300, known=known)
    weights = np.exp(scores - np.max(scores))
    weights /= np.sum(weights)
    probable = np.sum(weights, axis=2, keepdims=True) > _NEGLIGIBLE
    products, means = _of_named(groups, np.where(probable, weights, 0.0), len(shown))
    mean, second = np.zeros(len(shown)), np.zeros((len(shown), len(shown)))
    for share, background, product, size in zip(weights.sum(axis=(1, 2)), backgrounds, products, means, strict=True):
        if share < _NEGLIGIBLE:
            continue
        # Named coefficients `x` beyond the background: it is then what is expected of `z - L x`.
        named, variances = np.flatnonzero(np.diag(product)), background.variances
        moved = -variances[:, None] * (background.white.T @ background.white[:, named])
        moved[named, np.arange(len(named))] += 1.0
        alone, further = variances * background.towards, moved @ size[named]
        mean += share * alone + further
        crossed, drawn = np.outer(alone, 0.5 * share * alone + further), background.white * variances
        second += crossed + crossed.T + moved @ product[np.ix_(named, named)] @ moved.T - share * (drawn.T @ drawn)
        second[np.diag_indices(len(shown))] += share * variances
    absorbed = candidates.of_same_size.T @ weights.sum(axis=0)
    hidden = np.flatnonzero(absorbed.any(axis=1))
    # Their signals are absorbed: the data say of them what they say of the size.
    # The sd of the normal distribution about zero that has the 95 % interval of a mixture of some of the sizes `w`,
    # by their probabilities; the remaining probability is at zero. The mixture's mean square is that of its largest
    # sizes.
    ends = np.geomspace(1e-3, 4.0 * _NAMED[-1], 200)
    outside = absorbed[hidden] @ erfc(ends / (np.sqrt(2.0) * _NAMED[:, None]))
    equal_interval = np.array([np.interp(-_OUTSIDE, -share, ends) for share in outside]) / float(-ndtri(_OUTSIDE / 2))
    second[hidden, hidden] += equal_interval**2
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
    sd[always] = np.maximum(sd[always], LEAST_TEMPERATURE_EFFECT)
    drawn = signals * sd
    root = dpotrf(np.eye(len(z)) + drawn @ drawn.T, lower=1)[0]
    white = dtrtrs(root, np.column_stack([signals, z]), lower=1)[0]
    rows, rest = white[:, :-1], white[:, -1]
    return _Background(sd**2, rows, rows.T @ rest, float(rest @ rest), float(np.sum(np.log(np.diag(root)))))


def _scored(
    backgrounds: list[_Background], candidates: Candidates, dof: int, least: float, *, known: bool
) -> tuple[Float[np.ndarray, "scales candidates sizes"], list[_OfOneRank]]:
    """Log posterior of each candidate with each size `w`, for each background; the candidates by their number of named
    directions. One without any has no size: the first counts for it."""
    towards = np.stack([background.towards for background in backgrounds])
    square = np.array([background.square for background in backgrounds])[:, None, None]
    half_log_det = np.array([background.half_log_det for background in backgrounds])[:, None, None]
    listed = candidates.named.any(axis=0)
    place = np.cumsum(listed) - 1
    white = np.stack([background.white[:, listed] for background in backgrounds])
    inner, squares = white.mT @ white, _NAMED[:, None] ** 2
    scores = np.zeros((len(backgrounds), len(candidates.log_prior), len(_NAMED)))
    counts, groups = candidates.named.sum(axis=1), []
    for count in np.unique(counts).tolist():
        numbers = np.flatnonzero(counts == count)
        columns = np.nonzero(candidates.named[numbers])[1].reshape(len(numbers), count)
        inside = place[columns]
        variances, axes = np.linalg.eigh(inner[:, inside[:, :, None], inside[:, None, :]])
        along = (axes.mT @ towards[:, columns, None])[..., 0]
        informed = 1.0 + squares * np.maximum(variances, 0.0)[:, :, None]
        group = _OfOneRank(numbers, columns, axes, along, squares / informed)
        explained = square - (group.variances @ along[..., None] ** 2)[..., 0]
        likelihood = -0.5 * explained if known else -0.5 * dof * np.log(np.maximum(explained, least))
        scores[:, numbers] = likelihood - 0.5 * np.sum(np.log(informed), axis=3) - np.log(len(_NAMED))
        groups.append(group)
    without = counts == 0
    scores[:, without, 0] += np.log(len(_NAMED))
    scores[:, without, 1:] = -np.inf
    return scores - half_log_det + np.log(UNDETECTED_WEIGHTS)[:, None, None] + candidates.log_prior[:, None], groups


def _of_named(
    groups: list[_OfOneRank], weights: Float[np.ndarray, "scales candidates sizes"], count: int
) -> tuple[Float[np.ndarray, "scales directions directions"], Float[np.ndarray, "scales directions"]]:
    """Mean products and means of the named coefficients beyond each background, by their share of the probability."""
    products, means = np.zeros((len(weights), count, count)), np.zeros((len(weights), count))
    for numbers, columns, axes, along, variances in groups:
        scale, number = np.nonzero(np.any(weights[:, numbers], axis=2))
        share, spread = weights[scale, numbers[number]], variances[scale, number]
        axes, sizes, columns = axes[scale, number], spread * along[scale, number][:, None], columns[number]
        along_axes, diagonal = (sizes * share[..., None]).mT @ sizes, np.arange(columns.shape[1])
        along_axes[:, diagonal, diagonal] += (share[:, None] @ spread)[:, 0]
        np.add.at(products, (scale[:, None, None], columns[:, :, None], columns[:, None]), axes @ along_axes @ axes.mT)
        np.add.at(means, (scale[:, None], columns), (axes @ (share[:, None] @ sizes).mT)[..., 0])
    return products, means
