"""A noise model from the figures of a data sheet, or from a static record."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from tumblecal.ground.errors import InputError
from tumblecal.noise.allan import AllanDeviation, averaging_factors, overlapping_allan
from tumblecal.noise.parts import Flicker, Noise, Part, Quantisation, RandomWalk, White


# Quantisation noise is accepted if it reduces chi-squared by this much. Neighbouring points of an overlapping Allan
# deviation are correlated, so the value is larger than for independent points.
_ACCEPTED = 15.0


def quantisation_and_misfit(allan: AllanDeviation, noise: Noise, axis: int) -> dict[str, float]:
    """Quantisation noise in addition to a noise model, and the misfit of both to a measured Allan deviation.

    **Arguments:**

    - `allan`: of one axis, g. `noise`: the model. `axis`: its index.

    **Returns:** `quantisation_g_s`: Q of the Allan variance `3 Q^2 / tau^2` (IEEE Std 952, C.1.5), 0 where it is not
    needed; `white_g_per_rthz`: of the white noise with it; `reduced_chi2`: chi-squared over the number of averaging times, each
    Allan variance with the sd from its degrees of freedom; about 1 for a correct model.
    """
    measured, tau = allan.deviation**2, allan.tau_s
    known = noise.allan_deviation(tau)[:, axis] ** 2

    def misfits(model: np.ndarray) -> np.ndarray:
        return np.sqrt(allan.dof / 2) * (measured / np.maximum(model, 1e-300) - 1)

    white = noise.coefficients()[axis]["white_g_per_rthz"]
    slow = known - white**2 / tau
    # White noise is fitted again, because steps between samples also contain quantisation noise.
    columns = np.stack([3 / tau**2, 1 / tau], axis=1)
    weights = np.sqrt(allan.dof / 2) / np.maximum(measured, 1e-300)
    squared, alone = (
        _non_negative(columns[:, first:] * weights[:, None], np.maximum(measured - slow, 0.0) * weights)
        for first in (0, 1)
    )
    with_quantisation, without = misfits(columns @ squared + slow), misfits(columns[:, 1:] @ alone + slow)
    if with_quantisation @ with_quantisation + _ACCEPTED > without @ without:
        squared, with_quantisation = np.array([0.0, white**2]), misfits(known)
    return {
        "quantisation_g_s": float(np.sqrt(squared[0])),
        "white_g_per_rthz": float(np.sqrt(squared[1])),
        "reduced_chi2": float(with_quantisation @ with_quantisation) / len(tau),
    }


def _non_negative(columns: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Least squares with coefficients of zero or more."""
    from scipy.optimize import nnls  # takes half a second, and most commands that simulate noise do not need it

    return nnls(columns, wanted)[0]


def from_figures(figures: Sequence[tuple[float, float]], *, period_s: float = 0.01, quantisation: float = 0.0) -> Noise:
    """White noise, flicker and (from three figures on) random walk that have these Allan deviations.

    **Arguments:**

    - `figures`: pairs of averaging time (s) and sd of means over it (g); the paper: (1, 1.2e-3), (100, 0.7e-3).
    - `period_s`: sample period. `quantisation`: resolution of the output, g; its contribution is subtracted first.

    **Raises:** `InputError` if no such sum of parts has these figures within 10 %.
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
    """White noise, flicker and random walk fitted to the Allan deviation of a static record (g).

    **Raises:** `InputError` for fewer than 16 samples.
    """
    if len(samples) < 16:
        raise InputError(f"{len(samples)} samples are too few for an Allan deviation; record 16 or more")
    allan = [
        overlapping_allan([of_axis], 1.0 / period_s, averaging_factors(len(samples), 1, 4)) for of_axis in samples.T
    ]
    target = np.stack([of_axis.deviation**2 for of_axis in allan], axis=1)
    kinds = ("white", "flicker", "walk")
    return _fitted(
        allan[0].tau_s, target, kinds, np.sqrt(len(samples) * period_s / allan[0].tau_s - 1), period_s, quantisation
    )


def _fitted(tau, target, names, weights, period_s: float, quantisation: float) -> Noise:
    """Non-negative least squares of Allan variances, relative to the target, axis by axis."""
    unit = np.ones(3)
    makers = {
        "white": White,
        "flicker": lambda size: Flicker(size, shortest_s=period_s),
        "walk": RandomWalk,
    }
    columns = [Noise((makers[name](unit),)).allan_deviation(tau)[:, 0] ** 2 for name in names]
    rounding = Quantisation(unit * quantisation, period_s)
    known = rounding.allan_variance(tau)
    sizes = np.zeros((len(names), 3))
    for axis in range(3):
        rows = weights / target[:, axis]
        wanted = np.maximum(target[:, axis] - known[:, axis], 0.0)
        sizes[:, axis] = _non_negative(np.stack(columns, axis=1) * rows[:, None], wanted * rows)
    parts: list[Part] = [rounding] if quantisation else []
    for name, size in zip(names, np.sqrt(sizes), strict=True):
        if np.any(size > 0):
            parts.append(makers[name](size))
    return Noise(tuple(parts))
