"""Checks of dwells: axes that do not respond to gravity; warm-up, trend, outliers, spectral lines, quantisation, losses."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy import ndimage, signal, special

from tumblecal.capture.decoding.samples import Floats
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# Fewest attitudes for the check, and smallest change of some axis between them, g.
_FEWEST, _TURNED_G = 4, 0.5
# An axis that changes by less than this share of the others has one reading in all attitudes.
_SAME = 0.02
# Gravity in a plane has a constant size, within this share (unequal scales, misalignment); two intervals may differ.
_ONE_SIZE, _OTHERS = 0.15, 2


def require_axes_answer(source: str, dwells: Sequence[Floats] | Floats) -> None:
    """Check that all axes respond to gravity when the triad is turned.

    An axis along which gravity is always zero does not change either; the other two axes then sense all of gravity, and their
    readings are on a circle. An axis is dead if they are not, or if its reading is exactly constant while the others show
    noise.

    **Arguments:**

    - `source`: name for the fault. `dwells`: samples of each attitude in g, shape (n, 3); a mean alone is one sample.

    **Raises:** `InputError` with the axes.
    """
    means = np.array([dwell.mean(0) for dwell in dwells]).reshape(-1, 3)
    if len(means) < _FEWEST or (moved := np.ptp(means, axis=0)).max() < _TURNED_G:
        return
    noisy = np.median([np.ptp(dwell, axis=0) > 0 for dwell in dwells], axis=0) > 0
    stuck, constant = list[str](), list[str]()
    for axis in np.flatnonzero(moved < _SAME * moved.max()).tolist():
        others = np.delete(np.arange(3), axis)
        if noisy[others].any() and all((dwell[:, axis] == dwells[0][0, axis]).all() for dwell in dwells):
            stuck.append(AXES[axis])
        elif not _on_circle(means[:, others]):
            constant.append(AXES[axis])
    # If two axes do not change, one of them may be without gravity.
    if dead := stuck or constant:
        verb = "axis {} does" if len(dead) == 1 else "axes {} do"
        raise InputError(
            f"{source}: {verb.format(', '.join(dead))} not respond: the same reading in all attitudes "
            f"({1e3 * means[0, AXES.index(dead[0])]:.4g} mg in all {len(means)}; others change by up to {moved.max():.3g} g); "
            "check the channel and the column"
        )
    for first, second in combinations(range(3), 2):
        in_plane = means[:, [first, 3 - first - second]] * [np.sqrt(2), 1]
        sure = noisy[[first, second]].all() or not _on_circle(in_plane)
        if sure and all((dwell[:, first] == dwell[:, second]).all() for dwell in dwells):
            raise InputError(
                f"{source}: axes {AXES[first]} and {AXES[second]} have the same readings in every row: a channel or a column "
                "was taken twice; give each axis its column"
            )


def _on_circle(points: Floats) -> bool:
    """Whether points (n, 2) are approximately on a circle, by least squares of |p|² = 2 c p + k after their mean; for points on
    a line, whether they are its two ends."""
    points = points - points.mean(0)
    size = np.linalg.svd(points, compute_uv=False)
    centre = (points.max(0) + points.min(0)) / 2
    if size[1] >= _SAME * size[0]:
        design = np.hstack([2 * points, np.ones((len(points), 1))])
        centre = np.linalg.lstsq(design, (points**2).sum(1), rcond=None)[0][:2]
    radii = np.linalg.norm(points - centre, axis=1)
    usual = np.median(radii)
    return bool((np.abs(radii - usual) > _ONE_SIZE * usual).sum() < _OTHERS)


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
