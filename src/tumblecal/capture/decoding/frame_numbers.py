"""Numbers of frames in the order of sending, from a counter that wraps and a stream that may reorder.

A frame whose number is missing among the last few is a late one; a frame with the content of one of the last few
is a repeat. Every other step of the counter is forward (modular arithmetic); whole wraps need the host's stamps
(`losses`).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


# Contents of frames without their counter, for a slice of a piece: shape (n, k).
Content = Callable[[slice], NDArray]

# Number of later frames that may arrive before a frame that they overtook.
WINDOW = 8
# A counter with a larger forward step was reset: counters of 64 bits do not wrap.
_MOST_TICKS = 1 << 53


@dataclass(frozen=True)
class Numbered:
    """Frames as they arrived, shape (n,) each.

    **Arguments:**

    - `number`: in the device's order of sending, from 0 for the first that arrived; late frames have smaller numbers than
      the frame before.
    - `ticks`: the same in ticks of the counter, unwrapped.
    - `repeated`: whether the same frame had arrived before.
    """

    number: NDArray[np.int64]
    ticks: NDArray[np.int64]
    repeated: NDArray[np.bool_]


class FrameNumbers:
    """Numbers the frames of a stream, piece by piece.

    **Arguments:**

    - `modulus`: value at which the counter wraps. `step`: ticks from one frame to the next.

    `lost`: frames missing so far between the first and the last number, in `gaps` gaps; a late frame reduces both again.
    `repeats`: frames that arrived before; `replaced`: frames that the device replaced by a reply.
    """

    window: int
    lost: int
    gaps: int
    repeats: int
    replaced: int

    def __init__(self, modulus: int, step: int):
        self._modulus, self._step = modulus, step
        self.window = min(WINDOW, modulus // step // 4)
        self.lost = self.gaps = self.repeats = self.replaced = 0
        self._top = self._top_ticks = self._top_counter = -1
        self._last = -1  # number of the frame that arrived last
        self._lowest = 0
        self._floor = 0  # frames below this number belong to a device before its restart
        self._recent: dict[int, object] = {}
        self._short_gaps: list[set[int]] = []
        self._replies = 0

    def take(
        self,
        counter: NDArray[np.int64],
        content: Content | None = None,
        restarted: NDArray[np.bool_] | None = None,
        replies: NDArray[np.int64] | None = None,
    ) -> Numbered:
        """Number the next frames.

        **Arguments:**

        - `counter`: as the device sent it, shape (n,).
        - `content`: returns the contents of the frames of a slice, to recognise repeats; without it there are none.
        - `restarted`: whether the device restarted its counter before this frame, shape (n,).
        - `replies`: for each reply, the frame of this piece that follows it; n after the last frame.
        """
        n = len(counter)
        number, ticks, repeated = np.empty(n, np.int64), np.empty(n, np.int64), np.zeros(n, bool)
        if not n:
            self._replies += 0 if replies is None else len(replies)
            return Numbered(number, ticks, repeated)
        replied = np.bincount(np.zeros(0, np.int64) if replies is None else replies, minlength=n + 1)
        replied[0] += self._replies
        self._replies = int(replied[n])
        before = np.concatenate([[self._top_counter if self._last == self._top else -1], counter[:-1]])
        steps = (counter - before) % self._modulus
        ordinary = np.abs(steps - self._step) < self._step / 2
        if restarted is not None:
            ordinary &= ~restarted
        odd = np.flatnonzero(~ordinary)
        place = 0
        while place < n:
            if self._in_order():
                following = odd[np.searchsorted(odd, place)] if len(odd) and odd[-1] >= place else n
                if following > place:
                    run = slice(place, int(following))
                    number[run] = self._top + np.arange(1, run.stop - place + 1)
                    ticks[run] = self._top_ticks + np.cumsum(steps[run])
                    end = slice(max(run.start, run.stop - self.window - 1), run.stop)
                    self._advance(number[end], ticks[end], counter[end], None if content is None else content(end))
                    place = run.stop
                    continue
            fields = None if content is None else content(slice(place, place + 1))[0]
            again = restarted is not None and bool(restarted[place])
            number[place], ticks[place], repeated[place] = self._one(
                int(counter[place]), fields, int(replied[place]), restarted=again
            )
            place += 1
        return Numbered(number, ticks, repeated)

    def _in_order(self) -> bool:
        """Whether the last frame is the highest and none of the last few is missing: then a step of one is the next."""
        return bool(self._recent) and self._last == self._top and len(self._recent) > self.window

    def _advance(self, number, ticks, counter, content) -> None:
        """Register a run of frames in order, of which these are the last."""
        self._top, self._top_ticks, self._top_counter = int(number[-1]), int(ticks[-1]), int(counter[-1])
        self._last = self._top
        rows = [None] * len(number) if content is None else content
        self._recent |= dict(zip(number.tolist(), rows, strict=True))
        self._forget()

    def _forget(self) -> None:
        oldest = self._top - self.window
        if min(self._recent) < oldest:
            self._recent = {number: row for number, row in self._recent.items() if number >= oldest}
        if self._short_gaps:
            self._short_gaps = [gap for gap in self._short_gaps if max(gap) >= oldest]

    def _one(self, counter: int, content, replies: int, *, restarted: bool) -> tuple[int, int, bool]:
        """Number, ticks and whether it is a repeat, of one frame."""
        if not self._recent:
            self._top = self._top_ticks = self._last = 0
            self._floor = -self.window
            self._top_counter, self._recent = counter, {0: content}
            return 0, 0, False
        if restarted:
            return self._begun_again(counter, content)
        forward = (counter - self._top_counter) % self._modulus
        back = self._modulus - forward
        ahead, behind = round(forward / self._step), round(back / self._step)
        if ahead == 0 or behind == 0:
            return self._same_counter(forward if ahead == 0 else -back, content)
        number = self._top - behind
        if behind <= self.window and number >= self._floor:
            if number not in self._recent:
                return self._late(number, back, content)
            if _same(self._recent[number], content):
                self.repeats += 1
                self._last = number
                return number, self._top_ticks - back, True
        if forward > _MOST_TICKS:
            return self._begun_again(counter, content)
        return self._highest(ahead, forward, counter, content, replies)

    def _begun_again(self, counter: int, content) -> tuple[int, int, bool]:
        """The first frame after a restart of the counter."""
        self._recent.clear()
        self._floor = self._top + 1
        return self._highest(1, self._step, counter, content, 0)

    def _same_counter(self, ticks: int, content) -> tuple[int, int, bool]:
        """The counter of the highest frame again: a repeat, or whole wraps that only stamps can show."""
        self._last = self._top
        repeat = _same(self._recent[self._top], content)
        self.repeats += repeat
        return self._top, self._top_ticks + ticks, repeat

    def _late(self, number: int, back: int, content) -> tuple[int, int, bool]:
        self._recent[number], self._last = content, number
        self.lost += self._lowest - number - 1 if number < self._lowest else -1
        self._lowest = min(self._lowest, number)
        for gap in self._short_gaps:
            gap.discard(number)
        closed = [gap for gap in self._short_gaps if not gap]
        self.gaps -= len(closed)
        self._short_gaps = [gap for gap in self._short_gaps if gap]
        return number, self._top_ticks - back, False

    def _highest(self, ahead: int, forward: int, counter: int, content, replies: int) -> tuple[int, int, bool]:
        replaced = min(replies, ahead - 1)
        self.replaced += replaced
        if ahead - 1 > replaced:
            self.lost += ahead - 1 - replaced
            self.gaps += 1
            if ahead - 1 <= self.window:
                self._short_gaps.append(set(range(self._top + 1, self._top + ahead)))
        self._top += ahead
        self._top_ticks += forward
        self._top_counter, self._last = counter, self._top
        self._recent[self._top] = content
        self._forget()
        return self._top, self._top_ticks, False


def _same(first, second) -> bool:
    return first is not None and second is not None and bool(np.array_equal(first, second, equal_nan=True))
