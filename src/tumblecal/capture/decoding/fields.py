"""Numbers at known places of frames, read from all frames of one layout at once, and frames written from such numbers."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tumblecal.capture.decoding.framing import Found, Reading, rows_of
from tumblecal.capture.decoding.samples import Bytes, Event, Samples, blank, joined, not_a_number


class Field(NamedTuple):
    """One quantity of a frame.

    **Arguments:**

    - `at`: place in the frame. `kind`: its numpy type, with the count of numbers: "3>f4".
    - `scaled`: converts these numbers, shape (n, count), to the unit of `Samples`; floating-point numbers are float64.
    """

    at: int
    kind: DTypeLike
    scaled: Callable[[NDArray], NDArray] = np.asarray


class Layout(NamedTuple):
    """Layout of a frame.

    **Arguments:**

    - `fields`: the field of each quantity, by the name in `Samples`.
    - `describing`: places of the bytes that state the layout: frames of one size with equal bytes there have this layout.
    - `refused`: why no sample is read, if the frame has something like a specific force.
    - `event`: kind of the event of each frame without a specific force; "" for none.
    """

    fields: dict[str, Field]
    describing: list[int]
    refused: str = ""
    event: str = ""


def filled(rows: Bytes, fields: dict[str, Field]) -> Samples:
    """Samples of frames of one layout, shape (n, size); `stop` is not set."""
    samples = blank(len(rows))
    for quantity, (at, kind, scaled) in fields.items():
        kind = np.dtype(kind)
        values = np.ascontiguousarray(rows[:, at : at + kind.itemsize]).view(kind.base)
        target = getattr(samples, quantity)
        target[:] = scaled(values.astype(float) if kind.base.kind == "f" else values).reshape(target.shape)
    return samples


def reading(layout_of: Callable[[bytes], Layout]) -> Reading:
    """A function that reads self-describing frames; frames of one layout are read together."""

    def read(data: Bytes, found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        parts, events = list[Samples](), list[Event]()
        starts, sizes = found.starts, found.sizes
        while len(starts):
            size, frame = int(sizes[0]), data[starts[0] : starts[0] + sizes[0]]
            layout = layout_of(frame.tobytes())
            same = sizes == size
            for at in layout.describing:
                same[same] = data[starts[same] + at] == frame[at]
            stops = starts[same] + size + offset
            if "force" in layout.fields:
                samples = filled(rows_of(data, starts[same], size), layout.fields)
                samples.stop[:] = stops
                samples.status[:] |= not_a_number(samples.force)
                parts.append(samples)
            else:
                if layout.refused:
                    events.append(Event(int(stops[0]), "refused", {"text": layout.refused}))
                if layout.event:
                    events += [Event(stop, layout.event, {}) for stop in stops.tolist()]
            starts, sizes = starts[~same], sizes[~same]
        return in_order(parts), events

    return read


def in_order(parts: list[Samples]) -> Samples:
    """Samples of all parts in the order of the stream."""
    samples = joined(parts)
    return samples[np.argsort(samples.stop)] if len(parts) > 1 else samples


def frames_of(n: int, *parts: bytes | NDArray) -> Bytes:
    """`n` frames, shape (n, size): constant bytes, and columns of numbers, shape (n,) or (n, k), in their own type."""
    columns = [np.frombuffer(part * n, np.uint8) if isinstance(part, bytes) else part for part in parts]
    return np.hstack([np.ascontiguousarray(column).view(np.uint8).reshape(n, -1) for column in columns])
