"""Thousands of exact fits of the nominal chain at once, from the harmonics of a uniform plan.

For equally spaced spindle angles and equal weights the mean, sine and cosine of each axis at each pitch setting are
exact sufficient statistics, and for given pitch angles B = beta + dbeta the chain is affine in them: axis a at setting k has

    mean   m_ak = bias_a - M_a0 sin B_k        sine  M_a1 cos B_k        cosine  M_a2 cos B_k

Eliminating M and bias (variable projection: Golub and Pereyra 1973) leaves the K pitch errors, which maximise a sum
of two Rayleigh quotients

    n  s'G s / s'C s  +  n/2  c'D c / c'c,     s = sin B, c = cos B, C = I - 11'/K,
    G = C (sum_a m_a m_a') C,   D = sum of d d' over the six sine and cosine columns,

solved by Newton's method with its exact K x K Hessian. Everything is written by component on arrays whose last axis
is the trial ("lane"), so that the compiler runs it at the speed of elementwise arithmetic.
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


def _total(terms: Iterable[Lane]) -> Lane:
    """Sum of one or more lanes, in their order."""
    return functools.reduce(operator.add, terms)


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
    settings = range(len(pitch))
    mean = [[harmonics[k, 0, a] for a in range(3)] for k in settings]
    waves = [[harmonics[k, h, a] for a in range(3) for h in (1, 2)] for k in settings]
    centre = [_total(mean[k][a] for k in settings) / len(pitch) for a in range(3)]
    means = [[mean[k][a] - centre[a] for a in range(3)] for k in settings]
    sine, cosine, last = _pitch_angles(_gram(means), _gram(waves), pitch, angles)
    across, offset = _affine(means, waves, centre, sine, cosine)
    values, proper = _split(across, offset)
    dbeta = [
        jnp.arctan2(s * np.cos(b) - c * np.sin(b), c * np.cos(b) + s * np.sin(b))
        for s, c, b in zip(sine, cosine, pitch, strict=True)
    ]
    squares = _sum_of_squares(harmonics, across, offset, sine, cosine, angles)
    stacked = jnp.stack([*values, *dbeta])
    finite = jnp.isfinite(_total(values) + _total(dbeta) + squares)
    return HarmonicFits(stacked, squares, finite & proper & (last < LAST_STEP))


def _gram(rows: list[list[Lane]]) -> list[list[Lane]]:
    """Products of the rows with each other, lower triangle mirrored."""
    gram = [
        [_total(x * y for x, y in zip(rows[i], rows[j], strict=True)) for j in range(i + 1)] for i in range(len(rows))
    ]
    return [[gram[max(i, j)][min(i, j)] for j in range(len(rows))] for i in range(len(rows))]


def _pitch_angles(
    G: list[list[Lane]], D: list[list[Lane]], pitch: np.ndarray, angles: int
) -> tuple[list[Lane], list[Lane], Lane]:
    """Sines and cosines of the pitch angles that maximise the two quotients, and the length of the last step."""
    settings = range(len(pitch))
    nothing = jnp.zeros_like(G[0][0])

    def unfinished(state):
        count, _, _, last = state
        return (count < MOST_STEPS) & jnp.any(last >= LAST_STEP)

    def newton(state):
        count, sine, cosine, _ = state
        gradient, hessian = _derivatives(G, D, [sine[k] for k in settings], [cosine[k] for k in settings], angles)
        step = _cholesky_solve(hessian, gradient)
        longest = jnp.abs(step[0])
        for part in step[1:]:
            longest = jnp.maximum(longest, jnp.abs(part))
        half = 0.5 * jnp.minimum(1.0, LONGEST_STEP / jnp.maximum(longest, 1e-300))
        turned = []
        for k in settings:
            t = half * step[k]
            denominator = 1.0 / (1.0 + t * t)
            c, s = (1.0 - t * t) * denominator, 2.0 * t * denominator
            turned.append((sine[k] * c + cosine[k] * s, cosine[k] * c - sine[k] * s))
        return count + 1, [s for s, _ in turned], [c for _, c in turned], longest

    start = (
        jnp.zeros((), int),
        [nothing + np.sin(b) for b in pitch],
        [nothing + np.cos(b) for b in pitch],
        nothing + 1.0,
    )
    _, sine, cosine, last = jax.lax.while_loop(unfinished, newton, start)
    return sine, cosine, last


def _derivatives(
    G: list[list[Lane]], D: list[list[Lane]], sine: list[Lane], cosine: list[Lane], angles: int
) -> tuple[list[Lane], list[list[Lane]]]:
    """Gradient of the sum of quotients by the pitch angles, and minus its Hessian (both over n)."""
    count = len(sine)
    mean = _total(sine) / count
    s = [part - mean for part in sine]
    first, first_half = _quotient(G, s, [[(i == j) - 1 / count for j in range(count)] for i in range(count)])
    second, second_half = _quotient(D, cosine, [[float(i == j) for j in range(count)] for i in range(count)])
    gradient = [2 * first[k] * cosine[k] - second[k] * sine[k] for k in range(count)]
    hessian = []
    for i in range(count):
        row = []
        for j in range(i + 1):
            entry = -2 * cosine[i] * cosine[j] * first_half[i][j] - sine[i] * sine[j] * second_half[i][j]
            if i == j:
                entry = entry + 2 * first[i] * sine[i] + second[i] * cosine[i]
            row.append(entry)
        hessian.append(row)
    return gradient, hessian


def _quotient(A: list[list[Lane]], x: list[Lane], metric: list[list[float]]) -> tuple[list[Lane], list[list[Lane]]]:
    """Halves of the gradient and of the Hessian of `x'Ax / x'x` (x already projected, `metric` the projector)."""
    count = len(x)
    inverse = 1.0 / _total(part * part for part in x)
    product = [_total(A[i][j] * x[j] for j in range(count)) for i in range(count)]
    quotient = _total(part * other for part, other in zip(x, product, strict=True)) * inverse
    r = [(product[i] - quotient * x[i]) * inverse for i in range(count)]
    half = [
        [
            (A[i][j] - quotient * metric[i][j]) * inverse - 2 * inverse * (x[i] * r[j] + r[i] * x[j])
            for j in range(i + 1)
        ]
        for i in range(count)
    ]
    return r, half


def _less(lane: Lane, terms: Iterable[Lane]) -> Lane:
    """`lane` less the terms, one after the other."""
    return functools.reduce(operator.sub, terms, lane)


def _cholesky_solve(matrix: list[list[Lane]], right: list[Lane]) -> list[Lane]:
    """Solve with a positive definite matrix given by its lower triangle; not a number where it is not definite."""
    count = len(right)
    lower: list[list[Lane]] = []
    inverse: list[Lane] = []
    for i in range(count):
        row: list[Lane] = []
        for j in range(i):
            row.append(_less(matrix[i][j], (row[m] * lower[j][m] for m in range(j))) * inverse[j])
        inverse.append(jax.lax.rsqrt(_less(matrix[i][i], (part * part for part in row))))
        lower.append(row)
    y: list[Lane] = []
    for i in range(count):
        y.append(_less(right[i], (lower[i][m] * y[m] for m in range(i))) * inverse[i])
    x = list(y)
    for i in reversed(range(count)):
        x[i] = _less(y[i], (lower[m][i] * x[m] for m in range(i + 1, count))) * inverse[i]
    return x


def _affine(
    means: list[list[Lane]], waves: list[list[Lane]], centre: list[Lane], sine: list[Lane], cosine: list[Lane]
) -> tuple[list[list[Lane]], list[Lane]]:
    """The matrix M (rows: sensor axes) and the bias at given pitch angles."""
    count = len(sine)
    middle = _total(sine) / count
    s = [part - middle for part in sine]
    by_mean = 1.0 / _total(part * part for part in s)
    by_wave = 1.0 / _total(part * part for part in cosine)
    slope = [_total(s[k] * means[k][a] for k in range(count)) * by_mean for a in range(3)]
    wave = [_total(cosine[k] * waves[k][column] for k in range(count)) * by_wave for column in range(6)]
    matrix = [[-slope[a], wave[2 * a], wave[2 * a + 1]] for a in range(3)]
    return matrix, [centre[a] - slope[a] * middle for a in range(3)]


def nominal_harmonics(
    values: Float[Array, "free lanes"], pitch: Float[np.ndarray, " settings"]
) -> Float[Array, "settings 3 3 lanes"]:
    """Harmonics of the nominal chain at parameters (dK, bias, dtheta, gamma, dbeta): setting, harmonic, axis, trial."""
    dK, bias, angles, (g21, g31, g32) = values[0:3], values[3:6], values[6:9], values[9:12]
    (sx, sy, sz), (cx, cy, cz) = jnp.sin(angles), jnp.cos(angles)
    rx = [cy * cz, cy * sz, -sy]
    ry = [sx * sy * cz - cx * sz, sx * sy * sz + cx * cz, sx * cy]
    rz = [cx * sy * cz + sx * sz, cx * sy * sz - sx * cz, cx * cy]
    rows = [rx, [y + g21 * x for x, y in zip(rx, ry, strict=True)]]
    rows.append([z + g31 * x + g32 * y for x, y, z in zip(rx, ry, rz, strict=True)])
    M = [[(1.0 + dK[a]) * part for part in rows[a]] for a in range(3)]
    settings = []
    for k, beta in enumerate(pitch):
        sine, cosine = jnp.sin(beta + values[12 + k]), jnp.cos(beta + values[12 + k])
        means = jnp.stack([bias[a] - M[a][0] * sine for a in range(3)])
        settings.append(jnp.stack([means, *(jnp.stack([M[a][h] * cosine for a in range(3)]) for h in (1, 2))]))
    return jnp.stack(settings)


def _split(M: list[list[Lane]], bias: list[Lane]) -> tuple[list[Lane], Bool[Array, " lanes"]]:
    """The factors of `M = diag(1 + dK) T R` (see `closed_form.split`): dK, bias, dtheta, gamma; and whether det M > 0."""

    def dot(a, b):
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    def less(a, factor, b):
        return [x - factor * y for x, y in zip(a, b, strict=True)]

    scale_x = jnp.sqrt(dot(M[0], M[0]))
    rx = [part / scale_x for part in M[0]]
    yx = dot(M[1], rx)
    rest = less(M[1], yx, rx)
    scale_y = jnp.sqrt(dot(rest, rest))
    ry = [part / scale_y for part in rest]
    rz = [rx[1] * ry[2] - rx[2] * ry[1], rx[2] * ry[0] - rx[0] * ry[2], rx[0] * ry[1] - rx[1] * ry[0]]
    zx, zy, scale_z = dot(M[2], rx), dot(M[2], ry), dot(M[2], rz)
    dtheta = [
        jnp.arctan2(ry[2], rz[2]),
        jnp.arctan2(-rx[2], jnp.sqrt(rx[0] * rx[0] + rx[1] * rx[1])),
        jnp.arctan2(rx[1], rx[0]),
    ]
    dK = [scale_x - 1.0, scale_y - 1.0, scale_z - 1.0]
    return [*dK, *bias, *dtheta, yx / scale_y, zx / scale_z, zy / scale_z], scale_z > 0


def _sum_of_squares(harmonics: Array, across, offset, sine, cosine, angles: int) -> Lane:
    """Weighted sum of squares of the harmonics' residuals: n for means, n/2 for amplitudes."""
    total = jnp.zeros_like(sine[0])
    for k in range(len(sine)):
        level = _total((harmonics[k, 0, a] - offset[a] + across[a][0] * sine[k]) ** 2 for a in range(3))
        amplitude = _total((harmonics[k, h, a] - across[a][h] * cosine[k]) ** 2 for a in range(3) for h in (1, 2))
        total = total + angles * level + 0.5 * angles * amplitude
    return total
