"""Numbers of frames in the order of sending, from a counter that wraps and a stream that may reorder.

A frame whose number is missing among the last few is a late one; a frame with the content of one of the last few
is a repeat. Every other step of the counter is forward (modular arithmetic); whole wraps need the host's stamps
(`losses`).
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.samples import Decoded, Integers, Mask, Samples, Status, joined


if TYPE_CHECKING:
    from tumblecal.capture.protocols import DeviceCounter

# Contents of frames without their counter, for a slice of a piece: shape (n, k).
Content = Callable[[slice], NDArray]

# Number of later frames that may arrive before a frame that they overtook.
WINDOW = 8
# Number of samples from which the step of the counter is estimated.
_ENOUGH_FOR_STEP = 8
# A counter with a larger forward step was reset: counters of 64 bits do not wrap.
_MOST_TICKS = 1 << 53


def commonest_step(counter: Integers, modulus: int, restarted: Mask | None = None) -> int:
    """The usual step of a counter: exact if it counts samples, the median if it is a clock."""
    steps = np.diff(counter) % modulus
    steps = steps if restarted is None else steps[~restarted]
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
    - `repeated`: whether the same frame had arrived before.
    """

    number: Integers
    ticks: Integers
    repeated: Mask


class FrameNumbers:
    """Numbers the frames of a stream, piece by piece.

    **Arguments:**

    - `modulus`: value at which the counter wraps. `step`: ticks from one frame to the next.

    `lost`: frames missing so far between the first and the last number, in `gaps` gaps; a late frame reduces both again.
    `repeats`: frames that arrived before; `replaced`: frames that the device replaced by a reply.
    """

    def __init__(self, modulus: int, step: int):
        self._modulus, self._step = modulus, step
        self.window = min(WINDOW, modulus // step // 4)
        self.lost = self.gaps = self.repeats = self.replaced = 0
        # The highest number, and the number of the frame that arrived last.
        self._top, self._last, self._top_ticks, self._top_counter = -1, -1, -step, 0
        # Frames below `floor` belong to a device before its restart.
        self._lowest, self._floor, self._replies = 0, -self.window, 0
        # Contents of the last few frames, and for each missing frame how many are missing in its gap.
        self._recent: dict[int, bytes | None] = {}
        self._missing: dict[int, list[int]] = {}

    def take(
        self,
        counter: Integers,
        content: Content | None = None,
        restarted: Mask | None = None,
        replies: Integers | None = None,
    ) -> Numbered:
        """Number the next frames.

        **Arguments:**

        - `counter`: as the device sent it, shape (n,).
        - `content`: returns the contents of the frames of a slice, to recognise repeats; without it there are none.
        - `restarted`: whether the device restarted its counter before this frame, shape (n,).
        - `replies`: for each reply, the frame of this piece that follows it; n after the last frame.
        """
        n = len(counter)
        found = Numbered(np.empty(n, int), np.empty(n, int), np.zeros(n, bool))
        again = np.zeros(n, bool) if restarted is None else restarted
        replied = np.bincount(np.zeros(0, int) if replies is None else replies, minlength=n + 1)
        replied[0] += self._replies
        self._replies = int(replied[n])
        steps = np.diff(counter, prepend=self._top_counter) % self._modulus
        odd = np.append(np.flatnonzero((np.abs(steps - self._step) >= self._step / 2) | again), n)
        place = 0
        while place < n:
            # After a few frames in order, the next odd step ends a run.
            in_order = self._last == self._top and len(self._recent) > self.window
            stop = int(odd[np.searchsorted(odd, place)]) if in_order else place
            run = slice(place, stop)
            found.number[run] = self._top + np.arange(1, stop - place + 1)
            found.ticks[run] = self._top_ticks + np.cumsum(steps[run])
            if stop == place:
                stop += 1
                fields = None if content is None else content(slice(place, stop))[0].tobytes()
                arrived = self._one(int(counter[place]), fields, int(replied[place]), bool(again[place]))
                found.number[place], found.ticks[place], found.repeated[place] = arrived
            else:
                end = slice(max(place, stop - self.window - 1), stop)
                rows = [None] * (stop - end.start) if content is None else [row.tobytes() for row in content(end)]
                self._recent |= dict(zip(found.number[end].tolist(), rows, strict=True))
                self._highest(int(found.number[stop - 1]), int(found.ticks[stop - 1]), int(counter[stop - 1]))
            place = stop
        return found

    def _highest(self, number: int, ticks: int, counter: int) -> None:
        self._top, self._last, self._top_ticks, self._top_counter = number, number, ticks, counter
        self._recent = {k: row for k, row in self._recent.items() if k >= number - self.window}
        self._missing = {k: gap for k, gap in self._missing.items() if k >= number - self.window}

    def _one(self, counter: int, content: bytes | None, replies: int, restarted: bool) -> tuple[int, int, bool]:
        """Number, ticks and whether it is a repeat, of one frame."""
        forward = (counter - self._top_counter) % self._modulus
        back = self._modulus - forward
        ahead, behind = round(forward / self._step), round(back / self._step)
        number = self._top - behind
        if self._recent and not restarted:
            if ahead == 0 or behind == 0:
                # A repeat of the highest frame, or whole wraps that only stamps can show.
                self._last, repeat = self._top, content is not None and self._recent[self._top] == content
                self.repeats += repeat
                return self._top, self._top_ticks + (forward if ahead == 0 else -back), repeat
            near = behind <= self.window and number >= self._floor
            if near and number not in self._recent:
                self._late(number, content)
                return number, self._top_ticks - back, False
            if near and content is not None and self._recent[number] == content:
                self.repeats += 1
                self._last = number
                return number, self._top_ticks - back, True
            restarted = forward > _MOST_TICKS
        if restarted:
            self._floor = self._top + 1
        if restarted or not self._recent:
            self._recent, ahead, forward, replies = {}, 1, self._step, 0
        missing = ahead - 1
        replaced = min(replies, missing)
        self.replaced += replaced
        self.lost += missing - replaced
        self.gaps += missing > replaced
        if replaced < missing <= self.window:
            gap = [missing]
            self._missing |= dict.fromkeys(range(self._top + 1, self._top + ahead), gap)
        self._recent[self._top + ahead] = content
        self._highest(self._top + ahead, self._top_ticks + forward, counter)
        return self._top, self._top_ticks, False

    def _late(self, number: int, content: bytes | None) -> None:
        self._recent[number], self._last = content, number
        self.lost += self._lowest - number - 1 if number < self._lowest else -1
        self._lowest = min(self._lowest, number)
        gap = self._missing.pop(number, [0])
        gap[0] -= 1
        self.gaps -= gap[0] == 0


class CountedStream:
    """Numbers the samples of a stream without stamps: only losses that the device's counter shows are counted.

    **Arguments:**

    - `counter`: the device's counter, if there is one. `rate_hz`: the sample rate; otherwise the step is estimated.

    `numbers`: None before the step is known; `restarts`: restarts of the device since then.
    """

    numbers: FrameNumbers | None

    def __init__(self, counter: "DeviceCounter | None", rate_hz: float | None = None):
        self._counter, self._rate_hz, self._starting = counter, rate_hz, False
        self.numbers, self.restarts, self._early = None, 0, list[Samples]()

    def add(self, piece: Decoded) -> None:
        """Number the samples of the next piece."""
        samples, counter = piece.samples, self._counter
        if counter is None or not len(samples) or samples.counter[0] < 0:
            return
        starting = np.append(self._starting, (samples.status & Status.STARTING) != 0)
        restarted, self._starting = starting[1:] & ~starting[:-1], bool(starting[-1])
        if self.numbers is None:
            self._early.append(samples)
            samples = joined(self._early)
            if len(samples) < _ENOUGH_FOR_STEP:
                return
            step = commonest_step(samples.counter, counter.modulus)
            if counter.ticks_per_s and self._rate_hz:
                step = max(1, round(counter.ticks_per_s / self._rate_hz))
            self.numbers, restarted = FrameNumbers(counter.modulus, step), None
        else:
            self.restarts += int(restarted.sum())
        replies = np.array([event.stop for event in piece.events if event.counted], int)
        self.numbers.take(samples.counter, samples.content, restarted, np.searchsorted(samples.stop, replies))
