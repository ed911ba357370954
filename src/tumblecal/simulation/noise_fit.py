"""A noise model from what is known of an instrument: figures of its data sheet, or a static record."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls

from tumblecal.capture.allan import squared_differences
from tumblecal.errors import InputError
from tumblecal.simulation.noise import Noise, Part, Quantisation, RandomWalk, White, flicker


def from_figures(figures: Sequence[tuple[float, float]], *, period_s: float = 0.01, quantisation: float = 0.0) -> Noise:
    """White noise, flicker and (from three figures on) random walk that have these Allan deviations.

    **Arguments:**

    - `figures`: pairs of averaging time (s) and sd of means over it (g); the paper: (1, 1.2e-3), (100, 0.7e-3).
    - `period_s`: sample period. `quantisation`: resolution of the output, g; its share is taken off first.

    **Raises:** `InputError` when no such sum of parts has these figures within 10 %.
    """
    if len(figures) < 2:
        raise InputError("a noise model needs the sd at two averaging times or more, such as 1 s and 100 s")
    tau, sd = (np.array(column, float) for column in zip(*figures, strict=True))
    if np.any(tau <= 0) or np.any(sd <= 0):
        raise InputError("averaging times and their sd must be above 0")
    target = sd[:, None].repeat(3, axis=1) ** 2
    names = ("white", "flicker", "walk")[: min(len(figures), 3)]
    noise = _fitted(tau, target, names, np.ones(len(tau)), period_s, quantisation)
    reached = noise.allan_deviation(tau)[:, 0]
    if np.max(np.abs(reached / sd - 1)) > 0.1:
        shown = ", ".join(f"{value * 1e3:.3g} mg at {time:g} s" for time, value in zip(tau, reached, strict=True))
        raise InputError(f"no sum of white noise, flicker and random walk has these figures; nearest: {shown}")
    return noise


def from_record(samples: Float[np.ndarray, "samples 3"], period_s: float, *, quantisation: float = 0.0) -> Noise:
    """White noise, flicker and random walk fitted to the Allan deviation of a static record (g)."""
    tau, deviation, freedom = overlapping_allan(samples, period_s)
    return _fitted(tau, deviation**2, ("white", "flicker", "walk"), np.sqrt(freedom), period_s, quantisation)


def overlapping_allan(
    samples: Float[np.ndarray, "samples 3"], period_s: float
) -> tuple[Float[np.ndarray, " tau"], Float[np.ndarray, "tau 3"], Float[np.ndarray, " tau"]]:
    """Overlapping Allan deviation at octaves of the sample period, up to a quarter of the record.

    **Returns:** averaging times (s), deviations (g), approximate degrees of freedom (number of separate averages).

    **Raises:** `InputError` for fewer than 16 samples.
    """
    count = len(samples)
    if count < 16:
        raise InputError(f"{count} samples are too few for an Allan deviation; record 16 or more")
    lengths = 2 ** np.arange(int(np.log2(count // 4)) + 1)
    pooled = np.array([[squared_differences(samples[:, axis], n) for axis in range(3)] for n in lengths.tolist()])
    deviations = np.sqrt(pooled[:, :, 0] / (2.0 * lengths[:, None] ** 2 * pooled[:, :, 1]))
    return lengths * period_s, deviations, np.maximum(count / lengths - 1, 1.0)


def _fitted(tau, target, names, weights, period_s: float, quantisation: float) -> Noise:
    """Non-negative least squares of Allan variances, relative to the target, axis by axis."""
    one = np.ones(3)
    makers = {
        "white": lambda size: (White(size),),
        "flicker": lambda size: flicker(size, shortest_s=period_s),
        "walk": lambda size: (RandomWalk(size),),
    }
    columns = [Noise(makers[name](one)).allan_deviation(tau)[:, 0] ** 2 for name in names]
    rounding = Quantisation(one * quantisation, period_s)
    known = rounding.allan_variance(tau)
    sizes = np.zeros((len(names), 3))
    for axis in range(3):
        rows = weights / target[:, axis]
        wanted = np.maximum(target[:, axis] - known[:, axis], 0.0)
        sizes[:, axis] = nnls(np.stack(columns, axis=1) * rows[:, None], wanted * rows)[0]
    parts: list[Part] = [rounding] if quantisation else []
    for name, size in zip(names, np.sqrt(sizes), strict=True):
        if np.any(size > 0):
            parts += makers[name](size)
    return Noise(tuple(parts))
