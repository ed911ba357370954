"""Lost samples, counted exactly from the device's counter and the host's stamps.

A counter that wraps (STIM300: every 128 ms) does not determine the number of whole wraps in a gap. Host stamps are late by a
varying delay but never early, so the lower envelope of (host time - device time) is steady; it steps up by one wrap
for each wrap that the unwrapped counter misses. The steps are resolved in order from the lowest delay before and after; if
too few data follow, the gap is reported as unresolved instead of being guessed. Without a counter, the same steps estimate
the number of lost samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tumblecal.capture.decoding.frame_numbers import commonest_step, frame_numbers, window_of
from tumblecal.capture.decoding.samples import Floats, Integers, Mask, Samples


if TYPE_CHECKING:
    from tumblecal.capture.protocols import Protocol

# Time before and after a gap in which the lowest delay is searched, s.
_WINDOW_S = 2.0
_FEWEST_STAMPS = 10
_LATE_READ_S = 0.025
_SHORTEST_STEP_S = 0.02
# Rates by the host's clock are compared to this share, and to the delay of a read that is late, s.
SAME_RATE, _LATE_STAMP_S = 0.01, 0.2
# Share by which the clocks of device and host may differ.
_SAME_CLOCK = 0.1


class Gap(NamedTuple):
    """Samples missing between samples `after` and `after + 1`; `resolved` is False when whole wraps are uncertain."""

    after: int
    lost: int
    resolved: bool


@dataclass(frozen=True)
class Losses:
    """Losses between the first and the last sample.

    **Arguments:**

    - `gaps`: each gap.
    - `replaced`: samples that the device replaced by a reply. `duplicates`: samples that arrived before.
    - `rate_hz`: samples a second, lost ones included, by the clock of the device, or of the host; NaN for fewer than three
      stamps. `span_s`: duration by this clock.
    - `counted`: False without a counter; `lost` is then an estimate from time.
    """

    gaps: Sequence[Gap] = ()
    replaced: int = 0
    duplicates: int = 0
    rate_hz: float = np.nan
    span_s: float = np.nan
    counted: bool = True

    @property
    def lost(self) -> int:
        """Samples lost, all gaps together (unresolved ones with their best guess)."""
        return sum(gap.lost for gap in self.gaps)

    @property
    def unresolved(self) -> int:
        """Number of gaps of uncertain size."""
        return sum(not gap.resolved for gap in self.gaps)

    def rate_words(self, wanted_hz: float) -> str:
        """A warning if the rate differs from that by which a dwell is counted; "" if it does not."""
        if not abs(self.rate_hz / wanted_hz - 1) > SAME_RATE + 2 * _LATE_STAMP_S / self.span_s:
            return ""
        slow = ": baud rate too low?" if self.rate_hz < wanted_hz else ""
        return f"the device sends {self.rate_hz:.4g} samples a second, but {wanted_hz:.4g} are expected{slow}"

    def by_device(self, clock: Floats, host_s: Floats) -> "Losses":
        """With the rate by the device's clock (n,), if it shows them; `host_s`: stamp of each sample (n,).

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
        rate_hz, span_s = _rate(number, clock / unit)
        return replace(self, rate_hz=rate_hz, span_s=span_s)


def _rate(number: Integers, time_s: Floats) -> tuple[float, float]:
    """Samples a second and duration from the numbers of the samples that completed each stamp, and their times (n,)."""
    if len(time_s) < 3 or not time_s[-1] > time_s[0]:
        return np.nan, np.nan
    middle = int(np.clip(np.searchsorted(time_s, (time_s[0] + time_s[-1]) / 2), 1, len(time_s) - 2))
    rates = np.diff(number[[0, middle, -1]]) / np.diff(time_s[[0, middle, -1]])
    return float(rates.mean()), float(time_s[-1] - time_s[0])


def _last_of_stamps(host_s: Floats) -> Integers:
    """The last sample of each stamp."""
    return np.flatnonzero(np.append(host_s[1:] != host_s[:-1], True)[: len(host_s)])


def _slope(number: Integers, host_s: Floats, reach_s: float) -> float:
    """Host seconds a number (m,): the median over stretches of this length, so gaps do not matter; NaN for too few."""
    if len(number) < 3:
        return np.nan
    reach = int(np.clip(np.searchsorted(host_s, host_s[0] + reach_s), 1, len(number) // 3))
    run = number[reach:] - number[:-reach]
    slopes = (host_s[reach:] - host_s[:-reach])[run > 0] / run[run > 0]
    return float(np.median(slopes)) if len(slopes) else np.nan


def _steps(delay: Floats, host_s: Floats, unit_s: float, jump_s: float, silence_s: float) -> tuple[Integers, Mask]:
    """Steps of the lower envelope of the delay (m,) by whole units at each stamp, one after the other, and if they are certain.

    A step begins with a jump of the delay, after a silence.
    """
    steps, certain = np.zeros(len(delay), int), np.ones(len(delay), bool)
    fixed, floor = -_FEWEST_STAMPS, np.inf
    for i in (np.flatnonzero((np.diff(delay) > jump_s) & (np.diff(host_s) > silence_s)) + 1).tolist():
        first, stop = np.searchsorted(host_s, [host_s[i - 1] - _WINDOW_S, host_s[i] + _WINDOW_S]).tolist()
        # A few stamps between two steps may all be late: then the floor before the first step is still used.
        if i - fixed >= _FEWEST_STAMPS:
            floor = delay[max(min(first, i - 3 * _FEWEST_STAMPS), 0) : i].min()
        rise = delay[i:stop].min() - floor
        steps[i] = round(rise / unit_s) if rise > _SHORTEST_STEP_S else 0
        certain[i] = stop - i >= _FEWEST_STAMPS and host_s[-1] - host_s[i] >= 0.9 * _WINDOW_S
        certain[i] &= i >= _FEWEST_STAMPS or steps[i] == 0
        if steps[i] or not certain[i]:
            delay[i:] -= steps[i] * unit_s
            fixed = i
    return steps, certain


def _wraps(ticks: Integers, host_s: Floats, modulus: int) -> tuple[Integers, Mask]:
    """Whole wraps of the counter that are missing before each stamp (m,), and if they are certain.

    A first pass with a rough slope finds most of them; the slope of the corrected ticks then decides.
    """
    wraps, certain, tick_s = np.zeros(len(ticks), int), np.ones(len(ticks), bool), _slope(ticks, host_s, 1.0)
    for _ in range(3):
        wrap_s = modulus * tick_s
        # Whole wraps are lost only if nothing arrives for that long. If a virtual instrument runs much faster than real time, a
        # wrap is shorter than a read may be late.
        jump_s = 0.3 * wrap_s if wrap_s >= _SHORTEST_STEP_S else np.inf
        silence_s = max(0.5 * wrap_s, _LATE_READ_S)
        wraps, certain = _steps(host_s - ticks * tick_s, host_s, wrap_s, jump_s, silence_s)
        tick_s = _slope(ticks + np.cumsum(wraps) * modulus, host_s, np.inf)
    return wraps, certain


def count_losses(
    samples: Samples, host_s: Floats, modulus: int, step: int | None = None, special_after: Integers | tuple[()] = ()
) -> Losses:
    """Count the samples lost between the first and the last.

    A late sample fills its place, and a repeat is not an additional sample (`frame_numbers`).

    **Arguments:**

    - `samples`: n. `host_s`: stamp of the read that completed each sample, shape (n,), not decreasing.
    - `modulus`: value at which the counter wraps.
    - `step`: ticks from one sample to the next; the most frequent difference if None.
    - `special_after`: for each special frame the sample before it; a gap there is a reply, not a loss.
    """
    if len(samples) < 2:
        return Losses()
    step = step or commonest_step(samples.counter, modulus)
    number, repeated, restarted = frame_numbers(samples, modulus, step)
    # The samples in the order of sending, without repeats; losses across a restart cannot be counted.
    order = np.argsort(number, kind="stable")
    order = order[~repeated[order]]
    sent = number[order]
    missing, sure = np.diff(sent) - 1, np.ones(len(sent) - 1, bool)
    sure[np.searchsorted(sent, number[restarted]) - 1] = False
    last, highest = _last_of_stamps(host_s), np.maximum.accumulate(number)
    wraps, certain = _wraps(highest[last] * step, host_s[last], modulus)
    for stamp in np.flatnonzero((wraps > 0) | ~certain):
        # The gap is between the last sample of the stamp before and the first with a different step.
        between = np.arange(last[stamp - 1], last[stamp])
        odd = [*between[np.diff(highest)[between] != 1], between[0]]
        gap = min(int(np.searchsorted(sent, highest[odd[0]])), len(missing) - 1)
        missing[gap] += round(int(wraps[stamp]) * modulus / step)
        sure[gap] &= certain[stamp]
    duplicates = int(np.count_nonzero(repeated) + (missing < 0).sum())
    missing = np.maximum(missing, 0)
    # Replies: of the gap where they arrived, or one within the window.
    replaced, after = np.zeros_like(missing), order[:-1]
    for special in np.array(special_after, int):
        free = (replaced < missing) & (np.abs(after - special) <= window_of(modulus, step)) & (special >= 0)
        if free.any():
            replaced[np.argmin(np.where(free, np.abs(after - special), np.inf))] += 1
    lost = missing - replaced
    gaps = [Gap(int(order[k]), int(lost[k]), bool(sure[k])) for k in np.flatnonzero((lost > 0) | ~sure)]
    rate = _rate(highest[last] + np.cumsum(wraps) * modulus // step, host_s[last])
    return Losses(gaps, int(replaced.sum()), duplicates, *rate)


def losses_from_time(host_s: Floats) -> Losses:
    """An estimate for a stream without counter: pauses of the stamps that no later burst compensates.

    `host_s`: stamp of each sample, shape (n,).
    """
    last = _last_of_stamps(host_s)
    host_s, period = host_s[last], _slope(last, host_s[last], 1.0)
    lost, _ = _steps(host_s - last * period, host_s, period, _LATE_STAMP_S, 0.0)
    gaps = [Gap(int(last[stamp - 1]), int(lost[stamp]), False) for stamp in np.flatnonzero(lost)]
    return Losses(gaps, 0, 0, *_rate(last + np.cumsum(lost), host_s), counted=False)


def losses_of(
    protocol: "Protocol",
    samples: Samples,
    host_s: Floats,
    rate_hz: float | None,
    attempt: range,
    special_stops: list[int],
) -> Losses:
    """Losses among the samples of `attempt`, by the counter if there is one, otherwise by time; the others are context."""
    counter, inside = protocol.counter, slice(attempt.start, attempt.stop)
    if counter is None or not len(samples) or samples.counter[0] < 0:
        return losses_from_time(host_s[inside]).by_device(samples.clock[inside], host_s[inside])
    specials = np.searchsorted(samples.stop, np.array(special_stops, np.int64)) - 1
    found = count_losses(samples, host_s, counter.modulus, counter.step(rate_hz), specials)
    found = found.by_device(samples.clock, host_s)
    return replace(found, gaps=[gap for gap in found.gaps if attempt.start <= gap.after < attempt.stop - 1])
