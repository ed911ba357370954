"""The counts of a stream, piece by piece: of its decoder, of its status bits, and of the losses that its counter shows."""

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.capture.decoding.frame_numbers import WINDOW, commonest_step
from tumblecal.capture.decoding.losses import count_losses
from tumblecal.capture.decoding.samples import Counts, Decoded, Entry, Samples, Status, blank, joined


if TYPE_CHECKING:
    from tumblecal.capture.protocols import DeviceCounter

# Number of samples from which the step of the counter is estimated.
_ENOUGH_FOR_STEP = 8


class Tally:
    """The counts of a stream.

    **Arguments:**

    - `counter`: the device's counter, if there is one. `rate_hz`: the sample rate; otherwise the step is estimated.

    `counts`: of the decoder. `status`: number of samples by each status bit. `bytes`: received; `reopened`: times that the port
    was opened again. `numbered`: samples lost, gaps, samples replaced by replies, and repeats, by the counter; None before its
    step is known.
    """

    def __init__(self, counter: "DeviceCounter | None" = None, rate_hz: float | None = None):
        self._counter, self._rate_hz, self._step, self._last = counter, rate_hz, 0, blank(0)
        # Places of replies in the stream, just after the last samples.
        self._replies = list[int]()
        self.counts, self.status, self.bytes, self.reopened = Counts(), Counter[str](), 0, 0
        self.numbered: list[int] | None = None

    def add(self, piece: Decoded) -> None:
        """Count the next piece."""
        samples, counter = piece.samples, self._counter
        self.counts.add(piece.counts)
        for flag in Status:
            if hits := int(np.count_nonzero(samples.status & flag)):
                self.status[str(flag.name).lower()] += hits
        if counter is None or (len(samples) and samples.counter[0] < 0):
            return
        # Late frames and replies belong to gaps among the last few samples of the piece before.
        before = self._found(self._last, counter.modulus) if self.numbered else (0,) * 4
        self._replies += [event.stop for event in piece.events if event.counted]
        self._last = joined([self._last, samples])
        if len(samples) and len(self._last) >= _ENOUGH_FOR_STEP:
            self._step = (
                self._step or counter.step(self._rate_hz) or commonest_step(self._last.counter, counter.modulus)
            )
            found = np.subtract(self._found(self._last, counter.modulus), before)
            self.numbered = np.add(self.numbered or 0, found).tolist()
            self._last = self._last[-4 * WINDOW :]
            self._replies = [stop for stop in self._replies if stop > self._last.stop[0]]

    def _found(self, samples: Samples, modulus: int) -> tuple[int, ...]:
        host_s, replies = np.zeros(len(samples)), np.searchsorted(samples.stop, np.array(self._replies, int)) - 1
        found = count_losses(samples, host_s, modulus, self._step, replies)
        return found.lost, sum(gap.lost > 0 for gap in found.gaps), found.replaced, found.duplicates

    def line(self) -> str:
        """The counts as text for the screen."""
        c, flags = self.counts, "".join(f", {name} {n}" for name, n in self.status.items())
        return (
            f"frames {c.frames}, bad checks {c.check_failures}, resyncs {c.resyncs}, discarded bytes {c.discarded}, "
            f"lost >= {(self.numbered or [0])[0]}, reopened {self.reopened}{flags}"
        )

    def as_dict(self) -> Entry:
        """The counts for the journal."""
        lost, _, _, duplicates = self.numbered or [0] * 4
        others = {"lost_at_least": lost, "duplicates": duplicates, "bytes": self.bytes, "reopened": self.reopened}
        return vars(self.counts) | others | {"status": self.status}
