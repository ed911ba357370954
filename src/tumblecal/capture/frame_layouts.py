"""Self-describing frames: all frames of one layout are decoded together; unread frames are reported."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.framing import Found
from tumblecal.capture.samples import Event, Samples, blank, joined


_Layout = TypeVar("_Layout")


def decoded_by_layout(
    data: NDArray[np.uint8],
    found: Found,
    offset: int,
    layout_of: Callable[[bytes], tuple[_Layout, list[int]]],
    decode: Callable[[NDArray[np.int64], int, _Layout], Samples | None],
) -> Samples:
    """Samples of self-describing frames; frames of one layout are decoded together.

    **Arguments:**

    - `data`, `found`, `offset`: the frames, and the place of `data[0]` in the stream.
    - `layout_of`: the layout of a complete frame, and the places in it of the bytes that state the layout.
    - `decode`: the samples of frames of one layout (starts, size of each, layout); None if they have none.
    """
    parts: list[tuple[NDArray[np.int64], Samples]] = []
    rest = np.arange(len(found.starts))
    while len(rest):
        start, size = int(found.starts[rest[0]]), int(found.sizes[rest[0]])
        layout, describing = layout_of(data[start : start + size].tobytes())
        same = found.sizes[rest] == size
        for at in describing:
            same[same] = data[found.starts[rest[same]] + at] == data[start + at]
        samples = decode(found.starts[rest[same]], size, layout)
        if samples is not None:
            samples.stop[:] = found.starts[rest[same]] + size + offset
            parts.append((rest[same], samples))
        rest = rest[~same]
    if len(parts) <= 1:
        return parts[0][1] if parts else blank(0)
    order = np.argsort(np.concatenate([rows for rows, _ in parts]), kind="stable")
    return joined([samples for _, samples in parts])[order]


class Refusals:
    """Complete and valid frames that a decoder does not read, each kind reported once."""

    def __init__(self) -> None:
        self._said: set[str] = set()

    def event(self, stop: int, text: str) -> list[Event]:
        """The event that reports it; none if it was reported before."""
        if text in self._said:
            return []
        self._said.add(text)
        return [Event(stop, "refused", {"text": text})]
