"""Numbers of frames in the order of sending, from a counter that wraps and a stream that may reorder.

A frame whose number is missing among the last few is a late one; a frame with the content of one of the last few
is a repeat. Every other step of the counter is forward (modular arithmetic); whole wraps need the host's stamps
(`losses`).
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tumblecal.capture.decoding.samples import Decoded, Integers, Mask, Samples, Status, blank, content_of, joined


if TYPE_CHECKING:
    from tumblecal.capture.protocols import DeviceCounter

# Number of later frames that may arrive before a frame that they overtook.
WINDOW = 8
# Number of samples from which the step of the counter is estimated.
_ENOUGH_FOR_STEP = 8
# A counter with a larger forward step was reset: counters of 64 bits do not wrap.
_MOST_TICKS = 1 << 53


def commonest_step(counter: Integers, modulus: int) -> int:
    """The usual step of a counter: exact if it counts samples, the median if it is a clock."""
    steps = np.diff(counter) % modulus
    # Steps of more than half the counter are backwards.
    steps = steps[(steps > 0) & (steps <= modulus // 2)]
    if not len(steps):
        return 1
    values, counts = np.unique(steps, return_counts=True)
    return int(values[np.argmax(counts)] if counts.max() > len(steps) / 4 else np.median(steps))


class Numbered(NamedTuple):
    """Frames as they arrived, shape (n,) each.

    **Arguments:**

    - `number`: in the device's order of sending, from 0 for the first that arrived; late frames have smaller numbers than
      the frame before.
    - `ticks`: the same in ticks of the counter, unwrapped.
    - `repeated`: whether the same frame had arrived before. `restarted`: whether the device restarted before it.
    """

    number: Integers
    ticks: Integers
    repeated: Mask
    restarted: Mask


class FrameNumbers:
    """Numbers the frames of a stream, piece by piece.

    **Arguments:**

    - `modulus`: value at which the counter wraps. `step`: ticks from one frame to the next.

    `gaps`: number of gaps between the first and the last number. `repeats`: frames that arrived before; `replaced`: frames that
    the device replaced by a reply; `restarts`: restarts of the device.
    """

    def __init__(self, modulus: int, step: int):
        self._modulus, self._step = modulus, step
        self.window = min(WINDOW, modulus // step // 4)
        self.gaps = self.repeats = self.replaced = self.restarts = 0
        # The highest number with its ticks and counter, the number that arrived last, the lowest one, and how many arrived.
        self._top, self._ticks, self._counter = -1, -step, 0
        self._last, self._lowest, self._arrived = -1, 0, 0
        # Frames below `floor` belong to a device before its restart.
        self._floor, self._replies, self._starting = -self.window, 0, True
        # Contents of the last few frames, by number.
        self._recent = dict[int, bytes]()

    @property
    def lost(self) -> int:
        """Number of frames missing so far between the first and the last number."""
        return self._top + 1 - self._lowest - self._arrived - self.replaced

    def take(self, samples: Samples, replies: Integers | tuple[()] = ()) -> Numbered:
        """Number the next frames.

        **Arguments:**

        - `samples`: as they arrived, n.
        - `replies`: for each reply, the sample that follows it; n after the last one.
        """
        n, step = len(samples), self._step
        starting = np.append(self._starting, (samples.status & Status.STARTING) > 0)
        restarted, self._starting = starting[1:] & ~starting[:-1], bool(starting[-1])
        self.restarts += int(restarted.sum())
        found = Numbered(np.empty(n, int), np.empty(n, int), np.zeros(n, bool), restarted)
        replied = np.bincount(np.array(replies, int), minlength=n + 1)
        replied[0] += self._replies
        self._replies = int(replied[n])
        steps = np.diff(samples.counter, prepend=self._counter) % self._modulus
        odd = np.append(np.flatnonzero((np.abs(steps - step) >= step / 2) | restarted), n)
        place = 0
        while place < n:
            # After a frame in order, the next odd step ends a run.
            stop = int(odd[np.searchsorted(odd, place)]) if self._recent and self._last == self._top else place
            run, one = slice(place, stop), samples[place : place + 1]
            if stop == place:
                stop += 1
                arrived = self._one(one, int(replied[place]), bool(restarted[place]))
                found.number[place], found.ticks[place], found.repeated[place] = arrived
            else:
                found.number[run] = np.arange(self._top + 1, self._top + 1 + stop - place)
                found.ticks[run] = self._ticks + np.cumsum(steps[run])
                end = slice(max(place, stop - self.window - 2), stop)
                contents = map(bytes, content_of(samples[end]))
                self._recent |= dict(zip(found.number[end].tolist(), contents, strict=True))
                self._arrived += stop - place
                self._highest(*(int(of[stop - 1]) for of in (found.number, found.ticks, samples.counter)))
            place = stop
        return found

    def _highest(self, number: int, ticks: int, counter: int) -> None:
        self._top = self._last = number
        self._ticks, self._counter = ticks, counter
        self._recent = {k: row for k, row in self._recent.items() if k >= number - self.window - 1}

    def _one(self, sample: Samples, replies: int, restarted: bool) -> tuple[int, int, bool]:
        """Number, ticks and whether it is a repeat, of one frame."""
        counter, content = int(sample.counter[0]), bytes(content_of(sample)[0])
        forward = (counter - self._counter) % self._modulus
        ahead, behind = round(forward / self._step), round((self._modulus - forward) / self._step)
        if self._recent and not restarted:
            number = self._top - (behind if ahead else 0)
            ticks = self._ticks + forward - (self._modulus if ahead else 0)
            near, known = behind <= self.window or not ahead, self._recent.get(number)
            if near and known == content:
                self.repeats += 1
                self._last = number
                return number, ticks, True
            if number == self._top:
                # Whole wraps, which only stamps can show.
                self._last = number
                return number, ticks, False
            if near and known is None and number >= self._floor:
                self.gaps += 1 - (number - 1 in self._recent) - (number + 1 in self._recent)
                self._recent[number], self._last = content, number
                self._lowest = min(self._lowest, number)
                self._arrived += 1
                return number, ticks, False
            restarted = forward > _MOST_TICKS
        if restarted:
            self._floor = self._top + 1
        if restarted or not self._recent:
            self._recent, ahead, forward, replies = {}, 1, self._step, 0
        replaced = min(replies, ahead - 1)
        self.replaced += replaced
        self.gaps += ahead - 1 > replaced
        self._arrived += 1
        self._recent[self._top + ahead] = content
        self._highest(self._top + ahead, self._ticks + forward, counter)
        return self._top, self._ticks, False


class CountedStream:
    """Numbers the samples of a stream without stamps: only losses that the device's counter shows are counted.

    **Arguments:**

    - `counter`: the device's counter, if there is one. `rate_hz`: the sample rate; otherwise the step is estimated.

    `numbers`: None before the step is known.
    """

    numbers: FrameNumbers | None

    def __init__(self, counter: "DeviceCounter | None", rate_hz: float | None = None):
        self._counter, self._rate_hz = counter, rate_hz
        self.numbers, self._early = None, blank(0)

    def add(self, piece: Decoded) -> None:
        """Number the samples of the next piece."""
        samples, counter = piece.samples, self._counter
        if counter is None or not len(samples) or samples.counter[0] < 0:
            return
        if self.numbers is None:
            samples = self._early = joined([self._early, samples])
            if len(samples) < _ENOUGH_FOR_STEP:
                return
            step = commonest_step(samples.counter, counter.modulus)
            if counter.ticks_per_s and self._rate_hz:
                step = max(1, round(counter.ticks_per_s / self._rate_hz))
            self.numbers = FrameNumbers(counter.modulus, step)
        replies = np.array([event.stop for event in piece.events if event.counted], int)
        self.numbers.take(samples, np.searchsorted(samples.stop, replies))
