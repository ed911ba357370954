"""Checks of one dwell: warm-up, trend, outliers, spectral lines, quantisation, saturation, losses."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage, signal, special

from tumblecal.capture.decoding.samples import Floats
from tumblecal.ground.axes import AXES


_WARM_UP_P = 1e-6
_TREND_T = 4.5
_OUTLIER_SD = 6.0
_LINE_FALSE_ALARM = 1e-4
_MAINS_HZ = (50.0, 60.0, 100.0, 120.0, 150.0, 180.0)
# Bins of the periodogram over which its local median is taken.
_LOCAL = 31
# Number of samples among which the smallest step is searched.
_STEPS_OF = 200_000


@dataclass(frozen=True)
class Line:
    """A spectral line of one axis: observed frequency, amplitude, and possible cause."""

    axis: str
    frequency_hz: float
    amplitude_ug: float
    cause: str


@dataclass(frozen=True)
class DwellChecks:
    """Findings on one dwell; `warnings` are the findings in words, empty for a good dwell."""

    warm_up_g: list[float]
    warm_up_time_s: float
    warm_up_p: float
    trend_g_per_h: list[float]
    trend_t: list[float]
    outliers: list[int]
    lines: list[Line]
    step_g: list[float]
    saturated: int
    lost: int
    lost_unresolved: int
    warnings: list[str]


def check_dwell(
    force: Floats,
    rate_hz: float,
    mean_sd: Floats,
    *,
    saturated: int = 0,
    lost: int = 0,
    lost_unresolved: int = 0,
    rate_fault: str = "",
) -> DwellChecks:
    """Check the samples of one dwell.

    **Arguments:**

    - `force`: g, shape (n, 3). `rate_hz`: sample rate.
    - `mean_sd`: standard deviation of the mean per axis from the coloured noise; it sets the limit for a trend.
    - `saturated`, `lost`, `lost_unresolved`: counts from other checks; `rate_fault`: words of another.
    """
    # About sixty blocks: their times in s and means (k, 3).
    count = int(np.clip(len(force) // 8, 4, 60))
    size = len(force) // count
    times = np.asarray((np.arange(count) + 0.5) * size / rate_hz, np.float64)
    blocks = force[: count * size].reshape(count, size, 3).mean(1)
    amplitude, tau, p = _warm_up(times, blocks)
    # The change of a slope over white noise whose mean has standard deviation s has standard deviation sqrt(12) s.
    slope = np.polyfit(times, blocks, 1)[0]
    t = slope * (times[-1] + times[0]) / (np.sqrt(12) * np.maximum(mean_sd, 1e-12))
    deviation = np.abs(force - np.median(force, axis=0))
    limit = _OUTLIER_SD * np.maximum(1.4826 * np.median(deviation, axis=0), 1e-12)
    distinct = [np.unique(values[:_STEPS_OF]) for values in force.T]
    checks = DwellChecks(
        amplitude.tolist(),
        tau,
        p,
        (slope * 3600).tolist(),
        t.tolist(),
        (deviation > limit).sum(0).tolist(),
        _lines(force, rate_hz),
        [float(np.diff(values).min()) if len(values) > 1 else 0.0 for values in distinct],
        saturated,
        lost,
        lost_unresolved,
        [],
    )
    return replace(checks, warnings=[*_words(checks, force.std(0)), *filter(None, [rate_fault])])


def _words(checks: DwellChecks, sd: Floats) -> Iterator[str]:
    """The findings in words; `sd` (3): of the samples, g."""
    axis = int(np.argmax(np.abs(checks.trend_t)))
    if checks.warm_up_p < _WARM_UP_P:
        yield f"warm-up: {np.abs(checks.warm_up_g).max() * 1e6:.0f} ug, time constant {checks.warm_up_time_s:.0f} s"
    elif abs(checks.trend_t[axis]) > _TREND_T:
        slope_ug = checks.trend_g_per_h[axis] * 1e6
        yield f"trend: axis {AXES[axis]} {slope_ug:+.0f} ug/h ({abs(checks.trend_t[axis]):.0f} sd)"
    if max(checks.outliers) > 3:
        yield f"outliers: {', '.join(f'{k} on {a}' for a, k in zip(AXES, checks.outliers, strict=True) if k)}"
    if checks.lines:
        line = max(checks.lines, key=lambda line: line.amplitude_ug)
        cause = f" ({line.cause})" if line.cause else ""
        yield f"spectral line: axis {line.axis} {line.frequency_hz:.2f} Hz, {line.amplitude_ug:.0f} ug{cause}"
    if coarse := [a for a, s, q in zip(AXES, sd, checks.step_g, strict=True) if q == 0 or q > 2 * s]:
        width = f" ({1e3 * max(checks.step_g):.3g} mg)" if max(checks.step_g) > 0 else ""
        yield f"quantisation: axis {', '.join(coarse)} steps by more than its noise{width}: means are biased"
    if checks.saturated:
        yield f"saturation: {checks.saturated} samples at full scale or overloaded"
    if checks.lost or checks.lost_unresolved:
        unresolved = f", {checks.lost_unresolved} gap(s) unresolved" if checks.lost_unresolved else ""
        yield f"lost: {checks.lost} samples{unresolved}"


def _warm_up(times: Floats, blocks: Floats) -> tuple[Floats, float, float]:
    """Amplitude per axis, time constant and probability of a decaying exponential in addition to a straight line."""
    k, duration = len(times), times[-1] + times[0]
    # The components of exponentials orthogonal to straight lines, for time constants as shares of the duration.
    shares = np.geomspace(1 / 30, 1 / 3, 20)
    relative = (np.arange(k) + 0.5) / k
    line, _ = np.linalg.qr(np.stack([np.ones(k), relative], axis=1))
    decays = np.exp(-relative[:, None] / shares)
    decays = decays - line @ (line.T @ decays)
    norm = np.linalg.norm(decays, axis=0)
    decays = decays / norm
    straight = blocks - line @ (line.T @ blocks)
    # An axis that never changes has only rounding residuals, which are not a warm-up.
    rounding = k * (1e-14 * np.abs(blocks).max()) ** 2 + 1e-30
    without = (straight**2).sum(0) + rounding
    explained = decays.T @ straight
    residual = ((straight - decays.T[:, :, None] * explained[:, None]) ** 2).sum(1)
    best = int(np.argmin((residual / without).sum(1)))
    f, dof = without / (residual[best] + rounding) - 1.0, max(k - 4, 1)
    # Twenty time constants were tried on three axes.
    p = min(1.0, 60 * float(special.fdtrc(1, dof, np.maximum(f, 0.0) * dof).min()))
    return explained[best] / norm[best], float(shares[best] * duration), p


def _lines(force: Floats, rate_hz: float) -> list[Line]:
    """Peaks of the averaged periodogram above its local median, at a fixed false-alarm probability a dwell."""
    segment = int(2 ** np.clip(np.floor(np.log2(max(len(force) // 6, 8))), 6, 13))
    if len(force) < 4 * segment:
        return []
    # A trend of the whole dwell is removed once; its residual in a segment stays within the bins that are cut.
    straight = signal.detrend(force, axis=0)
    _, density = signal.welch(straight, rate_hz, "hann", segment, detrend=False, axis=0)  # type: ignore[arg-type]
    density, bin_hz = density[3:-1], rate_hz / segment
    floor = ndimage.median_filter(density, (_LOCAL, 1), mode="reflect")
    # Overlapping Hann segments: about 0.55 of them count as independent.
    dof = max(2.0, 2 * (2 * len(force) // segment - 1) * 0.947)
    limit = special.chdtri(dof, _LINE_FALSE_ALARM / len(density)) / special.chdtri(dof, 0.5)
    lines = []
    for axis, power, below in zip(AXES, density.T, floor.T, strict=True):
        over = np.flatnonzero(power > limit * np.maximum(below, 1e-30))
        for k in [k for k in over.tolist() if power[k] == power[max(k - 3, 0) : k + 4].max()][:5]:
            near = slice(max(k - 2, 0), k + 3)
            amplitude = float(np.sqrt(2 * max((power[near] - below[near]).sum() * bin_hz, 0.0)) * 1e6)
            frequency, cause = (k + 3) * bin_hz, ""
            for mains in _MAINS_HZ:
                alias = abs((mains + rate_hz / 2) % rate_hz - rate_hz / 2)
                if not cause and abs(frequency - alias) < 2 * bin_hz:
                    cause = f"mains, {mains:g} Hz" + ("" if mains <= rate_hz / 2 else ", aliased")
            lines.append(Line(axis, frequency, amplitude, cause))
    return lines
