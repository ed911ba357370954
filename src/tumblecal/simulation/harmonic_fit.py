"""Thousands of exact fits of the nominal chain at once, from the harmonics of a uniform plan.

For equally spaced spindle angles and equal weights the mean, sine and cosine of each axis at each pitch setting are
exact sufficient statistics, and for given pitch angles B = beta + dbeta the chain is affine in them: axis a at setting k has

    mean   m_ak = bias_a - M_a0 sin B_k        sine  M_a1 cos B_k        cosine  M_a2 cos B_k

Eliminating M and bias (variable projection: Golub and Pereyra 1973) leaves the K pitch errors, which maximise a sum
of two Rayleigh quotients

    n  s'G s / s'C s  +  n/2  c'D c / c'c,     s = sin B, c = cos B, C = I - 11'/K,
    G = C (sum_a m_a m_a') C,   D = sum of d d' over the six sine and cosine columns,

solved by Newton's method with its exact K x K Hessian. Vectors and matrices are numpy arrays of objects, whose entries are
arrays with one number for each trial ("lane"). So the program is written by component, and the compiler runs it at the
speed of elementwise arithmetic.
"""

import functools
import operator
from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float


# Newton's error after a step is of the order of the step squared: below this step the next would move nothing.
LAST_STEP = 1e-8
MOST_STEPS = 20
# 1 + t^2 below is the Cayley form of a rotation; a longer step is shortened to this (rad).
LONGEST_STEP = 0.5

Lane: TypeAlias = Float[Array, " lanes"]
# Entries are lanes.
Lanes: TypeAlias = np.ndarray


class HarmonicFits(NamedTuple):
    """Estimates of a batch: `values` (dK, bias, dtheta, gamma, dbeta; base units), the harmonics' weighted sum of
    squares, g^2, and whether each lane converged to a finite, proper solution."""

    values: Float[Array, "free lanes"]
    sum_of_squares: Lane
    converged: Bool[Array, " lanes"]


def fit_harmonics(
    harmonics: Float[Array, "settings 3 3 lanes"], pitch: Float[np.ndarray, " settings"], angles: int
) -> HarmonicFits:
    """Least-squares estimates of the nominal chain from harmonics.

    **Arguments:**

    - `harmonics`: of every setting, (mean, sine, cosine amplitude), sensor axis and trial, g.
    - `pitch`: commanded pitch of each setting, rad; at least three settings.
    - `angles`: number of spindle angles at each setting (the harmonics' weights).

    **Returns:** estimates, sums of squares and convergence of all lanes.
    """
    measured, count = _lanes(harmonics), len(pitch)
    centre = measured[:, 0].sum(axis=0) * (1 / count)
    means, waves = measured[:, 0] - centre, measured[:, 1:].reshape(count, 6)
    sine, cosine, last = _pitch_angles(_symmetric(means @ means.T), _symmetric(waves @ waves.T), pitch)
    middle = _sum(sine) * (1 / count)
    across = sine - middle
    slope = across @ means * (1.0 / _sum(across * across))
    wave = cosine @ waves * (1.0 / _sum(cosine * cosine))
    matrix, bias = np.stack([-slope, wave[:3], wave[3:]], axis=1), centre - slope * middle
    values, proper = _split(matrix)
    dbeta = [
        jnp.arctan2(s * np.cos(b) - c * np.sin(b), c * np.cos(b) + s * np.sin(b))
        for s, c, b in zip(sine, cosine, pitch, strict=True)
    ]
    residual = measured - _harmonics(matrix, bias, sine, cosine)
    level, sines, cosines = (residual * residual).sum(axis=(0, 2))
    squares = angles * level + 0.5 * angles * (sines + cosines)
    estimates = [*values[:3], *bias, *values[3:], *dbeta]
    finite = jnp.isfinite(functools.reduce(operator.add, estimates, squares))
    return HarmonicFits(jnp.stack(estimates), squares, finite & proper & (last < LAST_STEP))


def nominal_harmonics(
    values: Float[Array, "free lanes"], pitch: Float[np.ndarray, " settings"]
) -> Float[Array, "settings 3 3 lanes"]:
    """Harmonics of the nominal chain at parameters (dK, bias, dtheta, gamma, dbeta): setting, harmonic, axis, trial."""
    (sx, sy, sz), (cx, cy, cz) = jnp.sin(values[6:9]), jnp.cos(values[6:9])
    x = _vector([cy * cz, cy * sz, -sy])
    y = _vector([sx * sy * cz - cx * sz, sx * sy * sz + cx * cz, sx * cy])
    z = _vector([cx * sy * cz + sx * sz, cx * sy * sz - sx * cz, cx * cy])
    dK, bias, _, gamma = _lanes(values[:12]).reshape(4, 3)
    rows = np.stack([x, y + gamma[:1] * x, z + gamma[1:2] * x + gamma[2:] * y])
    beta = [b + values[12 + k] for k, b in enumerate(pitch)]
    made = _harmonics((1.0 + dK)[:, None] * rows, bias, _vector(map(jnp.sin, beta)), _vector(map(jnp.cos, beta)))
    return jnp.stack([jnp.stack([jnp.stack([*axes]) for axes in setting]) for setting in made])


def _vector(parts: Iterable[Lane]) -> Lanes:
    return np.fromiter(parts, object)


def _lanes(values: Float[Array, "*shape lanes"]) -> Lanes:
    """The leading axes of an array."""
    return _vector(values.reshape(-1, values.shape[-1])).reshape(values.shape[:-1])


def _sum(vector: Lanes) -> Lanes:
    """The sum as a vector of one entry: JAX does not multiply an array of objects by a lane."""
    return vector.sum(axis=0, keepdims=True)


def _symmetric(matrix: Lanes) -> Lanes:
    """The matrix by its lower triangle: no entry is computed twice."""
    return np.where(np.tri(len(matrix), dtype=bool), matrix, matrix.T)


def _harmonics(matrix: Lanes, bias: Lanes, sine: Lanes, cosine: Lanes) -> Lanes:
    """Harmonics (setting, harmonic, axis) by the matrix M (rows: sensor axes), the bias and the pitch angles."""
    means = bias - matrix[:, 0] * sine[:, None]
    return np.concatenate([means[:, None], matrix.T[1:] * cosine[:, None, None]], axis=1)


def _pitch_angles(G: Lanes, D: Lanes, pitch: Float[np.ndarray, " settings"]) -> tuple[Lanes, Lanes, Lane]:
    """Sines and cosines of the pitch angles that maximise the two quotients, and the length of the last step."""
    nothing = jnp.zeros_like(G[0, 0])

    def unfinished(state):
        count, _, _, last = state
        return (count < MOST_STEPS) & jnp.any(last >= LAST_STEP)

    def newton(state):
        count, sine, cosine, _ = state[0], _vector(state[1]), _vector(state[2]), state[3]
        step = _solved(*_derivatives(G, D, sine, cosine))
        longest = functools.reduce(jnp.maximum, map(jnp.abs, step))
        half = 0.5 * jnp.minimum(1.0, LONGEST_STEP / jnp.maximum(longest, 1e-300))
        t = step * _vector([half])
        scale = 1.0 / (1.0 + t * t)
        c, s = (1.0 - t * t) * scale, 2.0 * t * scale
        return count + 1, [*(sine * c + cosine * s)], [*(cosine * c - sine * s)], longest

    start = ([nothing + part for part in values] for values in (np.sin(pitch), np.cos(pitch)))
    _, sine, cosine, last = jax.lax.while_loop(unfinished, newton, (jnp.zeros((), int), *start, nothing + 1.0))
    return _vector(sine), _vector(cosine), last


def _derivatives(G: Lanes, D: Lanes, sine: Lanes, cosine: Lanes) -> tuple[Lanes, Lanes]:
    """Minus the Hessian of the sum of quotients by the pitch angles, and its gradient (both over n)."""
    unit, centred = np.eye(len(sine)), np.eye(len(sine)) - 1 / len(sine)
    first, first_half = _quotient(G, sine - _sum(sine) * (1 / len(sine)), centred)
    second, second_half = _quotient(D, cosine, unit)
    hessian = -2 * cosine[:, None] * cosine * first_half - sine[:, None] * sine * second_half
    hessian[np.diag_indices(len(sine))] += 2 * first * sine + second * cosine
    return _symmetric(hessian), 2 * first * cosine - second * sine


def _quotient(A: Lanes, x: Lanes, metric: np.ndarray) -> tuple[Lanes, Lanes]:
    """Halves of the gradient and of the Hessian of `x'Ax / x'x` (x already projected, `metric` the projector)."""
    inverse, product = 1.0 / _sum(x * x), A @ x
    quotient = _sum(x * product) * inverse
    r = (product - quotient * x) * inverse
    return r, (A - quotient * metric) * inverse - 2 * inverse * (x[:, None] * r + r[:, None] * x)


def _solved(matrix: Lanes, right: Lanes) -> Lanes:
    """Solve with a positive definite matrix by elimination; not a number where it is not definite."""
    size = len(right)
    factor, inverse = matrix.copy(), matrix.diagonal().copy()
    for k in range(size):
        for j in range(k):
            factor[k, j] = functools.reduce(operator.sub, factor[k, :j] * factor[j, :j], factor[k, j]) * inverse[j]
        inverse[k] = jax.lax.rsqrt(functools.reduce(operator.sub, factor[k, :k] * factor[k, :k], factor[k, k]))
    solution = right.copy()
    for k in range(size):
        solution[k] = functools.reduce(operator.sub, factor[k, :k] * solution[:k], solution[k]) * inverse[k]
    for k in reversed(range(size)):
        solution[k] = functools.reduce(operator.sub, factor[k + 1 :, k] * solution[k + 1 :], solution[k]) * inverse[k]
    return solution


def _split(M: Lanes) -> tuple[Lanes, Bool[Array, " lanes"]]:
    """The factors of `M = diag(1 + dK) T R` (see `closed_form.split`): dK, dtheta, gamma; and whether det M > 0."""
    x = M[0] * (1.0 / _length(M[0]))
    across = M[1] - _sum(M[1] * x) * x
    y = across * (1.0 / _length(across))
    z = x[[1, 2, 0]] * y[[2, 0, 1]] - x[[2, 0, 1]] * y[[1, 2, 0]]
    lower = M @ np.stack([x, y, z]).T
    scale = lower.diagonal()
    dtheta = [
        jnp.arctan2(y[2], z[2]),
        jnp.arctan2(-x[2], jnp.sqrt(x[0] * x[0] + x[1] * x[1])),
        jnp.arctan2(x[1], x[0]),
    ]
    gamma = lower[[1, 2, 2], [0, 0, 1]] / scale[[1, 2, 2]]
    return np.concatenate([scale - 1.0, _vector(dtheta), gamma]), scale[2] > 0


def _length(vector: Lanes) -> Lanes:
    return _vector(map(jnp.sqrt, _sum(vector * vector)))
