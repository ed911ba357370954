"""Lost samples, counted exactly from the device's counter and the host's stamps.

A counter that wraps (STIM300: every 128 ms) does not determine the number of whole wraps in a gap. Host stamps are late by a
varying delay but never early, so the lower envelope of (host time - device time) is steady; it steps up by one wrap
for each wrap that the unwrapped counter misses. The steps are resolved in order from the lowest delay before and after; if
too few data follow, the gap is reported as unresolved instead of being guessed.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from tumblecal.capture.decoding.frame_numbers import Content, FrameNumbers, commonest_step
from tumblecal.capture.decoding.samples import Floats, Integers


# Time before and after a gap in which the lowest delay is searched, s.
_WINDOW_S = 2.0
_FEWEST_STAMPS = 10
_LATE_READ_S = 0.025
_SHORTEST_WRAP_S = 0.02
# Rates by the host's clock are compared to this share, and to the delay of a read that is late, s.
SAME_RATE, _LATE_STAMP_S = 0.01, 0.2
# Share by which the clocks of device and host may differ.
_SAME_CLOCK = 0.1


@dataclass(frozen=True)
class Gap:
    """Samples missing between samples `after` and `after + 1`; `resolved` is False when whole wraps are uncertain."""

    after: int
    lost: int
    resolved: bool


class Rates(NamedTuple):
    """Samples a second in each half of a stretch, lost ones included, and the duration of a half, s."""

    first_hz: float
    second_hz: float
    half_s: float

    @classmethod
    def of(cls, number: Integers, time_s: Floats) -> "Rates":
        """From the numbers of the samples that completed each stamp, and their times (n,); NaN for too few."""
        if len(time_s) < 3 or not time_s[-1] > time_s[0]:
            return _NO_RATES
        middle = int(np.clip(np.searchsorted(time_s, (time_s[0] + time_s[-1]) / 2), 1, len(time_s) - 2))
        first, second = np.diff(number[[0, middle, -1]]) / np.diff(time_s[[0, middle, -1]])
        return cls(float(first), float(second), float(time_s[-1] - time_s[0]) / 2)

    @property
    def mean_hz(self) -> float:
        """Samples a second in both halves, which have the same duration."""
        return (self.first_hz + self.second_hz) / 2

    def words(self, wanted_hz: float) -> str:
        """A warning if the rates differ from each other, or from the rate by which a dwell is counted; "" if they do not."""
        near = SAME_RATE + _LATE_STAMP_S / self.half_s
        if abs(self.second_hz / self.first_hz - 1) > near:
            return f"the sample rate changed from {self.first_hz:.4g} to {self.second_hz:.4g} Hz"
        mean = self.mean_hz
        if abs(mean / wanted_hz - 1) <= near or not np.isfinite(near):
            return ""
        slow = ": baud rate too low?" if mean < wanted_hz else ""
        return f"the device sends {mean:.4g} samples a second, but {wanted_hz:.4g} are expected{slow}"


_NO_RATES = Rates(np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class Losses:
    """Losses between the first and the last sample.

    **Arguments:**

    - `lost`: samples lost, all gaps together (unresolved ones with their best guess).
    - `unresolved`: number of gaps of uncertain size.
    - `replaced`: samples that the device replaced by a reply.
    - `duplicates`: samples that arrived before.
    - `gaps`: each gap.
    - `rate_hz`: sample rate by the clock of the device, or of the host; NaN for fewer than two stamps. `rates`: of each half.
    - `counted`: False without a counter; `lost` is then an estimate from time.
    """

    lost: int = 0
    unresolved: int = 0
    replaced: int = 0
    duplicates: int = 0
    gaps: list[Gap] = field(default_factory=list)
    rate_hz: float = np.nan
    counted: bool = True
    rates: Rates = _NO_RATES

    def by_device(self, clock: Floats, host_s: Floats) -> "Losses":
        """With the rates by the device's clock (n,), if it shows them; `host_s`: stamp of each sample (n,).

        The clock must rise from sample to sample, in a power of ten of seconds by the stamps.
        """
        if len(clock) < 3 or not (np.diff(clock) > 0).all() or not host_s[-1] > host_s[0]:
            return self
        ticks_per_s = float((clock[-1] - clock[0]) / (host_s[-1] - host_s[0]))
        unit = 10.0 ** round(np.log10(ticks_per_s))
        if not abs(ticks_per_s / unit - 1) < _SAME_CLOCK:
            return self
        number = np.arange(len(clock))
        for gap in self.gaps:
            number[gap.after + 1 :] += gap.lost
        rates = Rates.of(number, clock / unit)
        return replace(self, rates=rates, rate_hz=rates.mean_hz)


def _last_of_stamps(host_s: Floats) -> Integers:
    """The last sample of each stamp."""
    return np.flatnonzero(np.append(host_s[1:] != host_s[:-1], True)[: len(host_s)])


def _window(host_s: Floats, stamp: int) -> tuple[int, int]:
    """The stamps shortly before and after a pause before `stamp`: the first, and the one behind the last."""
    return (
        int(np.searchsorted(host_s, host_s[stamp - 1] - _WINDOW_S)),
        int(np.searchsorted(host_s, host_s[stamp] + _WINDOW_S)),
    )


def _host_per_tick(ticks: Integers, host_s: Floats) -> float:
    """Host seconds a tick: the median slope over stretches of about a second, so gaps do not matter.

    **Arguments:**

    - `ticks`: unwrapped counter at the last sample of each stamp, shape (m,).
    - `host_s`: stamps, shape (m,).
    """
    if len(ticks) < 3:
        return np.nan
    reach = int(np.clip(np.searchsorted(host_s, host_s[0] + 1.0), 1, max(1, len(ticks) // 3)))
    run = ticks[reach:] - ticks[:-reach]
    slopes = (host_s[reach:] - host_s[:-reach])[run > 0] / run[run > 0]
    return float(np.median(slopes)) if len(slopes) else np.nan


def _envelope_slope(ticks: Integers, host_s: Floats, tick_s: float) -> float:
    """Host seconds a tick along the lower envelope: a line through the earliest stamps of many short stretches."""
    bins = int(np.clip(host_s[-1] - host_s[0], 2, 400))
    edges = np.unique(np.searchsorted(host_s, np.linspace(host_s[0], host_s[-1], bins + 1)[:-1]))
    if len(edges) < 4:
        return tick_s
    lowest, half = np.minimum.reduceat(host_s - ticks * tick_s, edges), len(edges) // 2
    middle = ticks[edges].astype(float)
    return tick_s + float(np.median((lowest[half:] - lowest[:-half]) / (middle[half:] - middle[:-half])))


def _wraps(ticks: Integers, host_s: Floats, modulus: int) -> tuple[list[tuple[int, int, bool]], float]:
    """Missing whole wraps: (stamp before which they are missing, how many, certain), and host seconds a tick.

    A first pass with a rough slope finds most of them; the slope along the corrected envelope then decides.
    """
    tick_s, wraps = _host_per_tick(ticks, host_s), list[tuple[int, int, bool]]()
    for sharper in (False, True, True) if np.isfinite(tick_s) else ():
        if sharper:
            corrected = ticks.copy()
            for stamp, count, _ in wraps:
                corrected[stamp:] += count * modulus
            tick_s = _envelope_slope(corrected, host_s, tick_s)
        wraps = _steps(host_s - ticks * tick_s, host_s, modulus * tick_s)
    return wraps, tick_s


def _steps(delay: Floats, host_s: Floats, wrap_s: float) -> list[tuple[int, int, bool]]:
    """Steps of the lower envelope of the delay by whole wraps, one after the other."""
    steps = list[tuple[int, int, bool]]()
    if wrap_s < _SHORTEST_WRAP_S:
        # Reads are late by the length of a wrap (only if a virtual instrument runs much faster than real time).
        return steps
    # Whole wraps are lost only if nothing arrives for that long, and for longer than a read may be late.
    silence_s = max(0.5 * wrap_s, _LATE_READ_S)
    late = np.flatnonzero((np.diff(delay) > 0.3 * wrap_s) & (np.diff(host_s) > silence_s)) + 1
    fixed, floor = -_FEWEST_STAMPS, np.inf
    for i in late.tolist():
        first, stop = _window(host_s, i)
        # A few stamps between two steps may all be late: then the floor before the first step is still used.
        if i - fixed >= _FEWEST_STAMPS:
            floor = delay[max(min(first, i - 3 * _FEWEST_STAMPS), 0) : i].min()
        wraps = round((delay[i:stop].min() - floor) / wrap_s)
        enough = stop - i >= _FEWEST_STAMPS and host_s[-1] - host_s[i] >= 0.9 * _WINDOW_S
        enough &= i >= _FEWEST_STAMPS or wraps == 0
        if wraps or not enough:
            steps.append((i, wraps, enough))
            delay[i:] -= wraps * wrap_s
            fixed = i
    return steps


def count_losses(
    counter: Integers,
    host_s: Floats,
    modulus: int,
    step: int | None = None,
    special_after: Integers | None = None,
    restarts: Integers | None = None,
    content: Content | None = None,
) -> Losses:
    """Count the samples lost between the first and the last.

    A late sample fills its place, and a repeat is not an additional sample (`FrameNumbers`).

    **Arguments:**

    - `counter`: as the device sent it, shape (n,).
    - `host_s`: stamp of the read that completed each sample, shape (n,), not decreasing.
    - `modulus`: value at which the counter wraps.
    - `step`: ticks from one sample to the next; the most frequent difference if None.
    - `special_after`: for each special frame the sample before it; a gap there is a reply, not a loss.
    - `restarts`: samples after which the device restarted; losses across a restart cannot be counted.
    - `content`: returns the contents of the samples of a slice, by which repeats are recognised.
    """
    n = len(counter)
    if n < 2:
        return Losses()
    restarted = np.zeros(n, bool)
    if restarts is not None:
        restarted[restarts[(restarts >= 0) & (restarts < n - 1)] + 1] = True
    step = step or commonest_step(counter, modulus, restarted[1:])
    frames = FrameNumbers(modulus, step)
    number, ticks, repeated = frames.take(counter, content, restarted)
    # The samples in the order of sending, without repeats.
    order = np.argsort(number, kind="stable")
    order = order[~repeated[order]]
    sent = number[order]
    missing = np.diff(sent) - 1
    sure = np.ones(len(missing), bool)
    sure[np.searchsorted(sent, number[restarted]) - 1] = False

    last = _last_of_stamps(host_s)
    wraps, tick_s = _wraps(np.maximum.accumulate(ticks)[last], host_s[last], modulus)
    highest = np.maximum.accumulate(number)
    leading = np.maximum.accumulate(np.where((number == highest) & ~repeated, np.arange(n), 0))
    place = np.zeros(n, int)
    place[order] = np.arange(len(order))
    for stamp, count, certain in wraps:
        # The gap is between the last sample of the stamp before and the first with a different step.
        between = np.arange(last[stamp - 1], last[stamp])
        odd = between[np.diff(highest)[between] != 1]
        gap = min(int(place[leading[(odd if len(odd) else between)[0]]]), len(missing) - 1)
        missing[gap] += round(count * modulus / step)
        sure[gap] &= certain
    duplicates = int(np.count_nonzero(repeated) + (missing < 0).sum())
    missing = np.maximum(missing, 0)
    replaced = _replaced(missing, order, special_after, frames.window)
    lost = missing - replaced
    return Losses(
        lost=int(lost.sum()),
        unresolved=int((~sure).sum()),
        replaced=int(replaced.sum()),
        duplicates=duplicates,
        gaps=[Gap(int(order[k]), int(lost[k]), bool(sure[k])) for k in np.flatnonzero((lost > 0) | ~sure)],
        rate_hz=float(1 / (tick_s * step)) if tick_s > 0 else np.nan,
        rates=Rates.of(highest[last], host_s[last]),
    )


def _replaced(missing: Integers, order: Integers, special_after: Integers | None, window: int) -> Integers:
    """Number of samples of each gap replaced by replies: of the gap where the reply arrived, or one within the window."""
    replaced, after = np.zeros_like(missing), order[:-1]
    for special in [] if special_after is None else special_after[special_after >= 0].tolist():
        free = np.flatnonzero((replaced < missing) & (np.abs(after - special) <= window))
        if len(free):
            replaced[min(free.tolist(), key=lambda k: (abs(after[k] - special), after[k]))] += 1
    return replaced


def losses_from_time(host_s: Floats, rate_hz: float | None) -> Losses:
    """An estimate for a stream without counter: pauses of the stamps that no later burst compensates.

    **Arguments:**

    - `host_s`: stamp of each sample, shape (n,).
    - `rate_hz`: the device's rate; estimated from the stream if None.
    """
    last = _last_of_stamps(host_s)
    if len(last) < 3:
        return Losses(counted=False)
    rates, host_s = Rates.of(last, host_s[last]), host_s[last]
    period = 1 / rate_hz if rate_hz else _host_per_tick(last, host_s)
    delay, gaps = host_s - last * period, list[Gap]()
    for i in (np.flatnonzero(np.diff(delay) > _LATE_STAMP_S) + 1).tolist():
        first, stop = _window(host_s, i)
        lost = round((delay[i:stop].min() - delay[first:i].min()) / period)
        if lost > 0.02 / period:
            gaps.append(Gap(int(last[i - 1]), lost, False))
            delay[i:] -= lost * period
    total = sum(gap.lost for gap in gaps)
    return Losses(total, len(gaps), gaps=gaps, rate_hz=1 / period, counted=False, rates=rates)
