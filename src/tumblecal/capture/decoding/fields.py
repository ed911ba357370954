"""Numbers at known places of frames: read from all frames of one layout at once, and written from samples."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tumblecal.capture.decoding.framing import Found, Reading, rows_of
from tumblecal.capture.decoding.samples import Bytes, Event, Samples, blank, joined, not_a_number
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


class Unit(NamedTuple):
    """Conversion of numbers, shape (n, count), to the unit of `Samples`, and back."""

    read: Callable[[Any], NDArray]
    write: Callable[[NDArray], NDArray] = np.asarray


PLAIN, RADIANS = Unit(np.asarray), Unit(np.degrees, np.radians)
MS2 = Unit(lambda ms2: ms2 / STANDARD_GRAVITY_MS2, lambda g: g * STANDARD_GRAVITY_MS2)


def scaled(factor: float | NDArray) -> Unit:
    """Numbers that are multiples of a factor."""
    return Unit(lambda numbers: numbers * factor, lambda values: values / factor)


class Field(NamedTuple):
    """One quantity of `Samples` in a frame: its numpy type, with the count of numbers ("3>f4"), and its unit."""

    quantity: str
    kind: DTypeLike
    unit: Unit = PLAIN


class Layout(NamedTuple):
    """Layout of a frame.

    **Arguments:**

    - `fields`: place of each field that is read.
    - `describing`: places of the bytes that state the layout: frames of one size with equal bytes there have this layout.
    - `refused`: why no sample is read, if the frame has something like a specific force.
    - `event`: kind of the event of each frame without a specific force; "" for none.
    """

    fields: dict[Field, int]
    describing: list[int]
    refused: str = ""
    event: str = ""


def filled(rows: Bytes, fields: dict[Field, int]) -> Samples:
    """Samples of frames of one layout, shape (n, size); `stop` is not set."""
    samples = blank(len(rows))
    for (quantity, kind, unit), at in fields.items():
        kind = np.dtype(kind)
        values = np.ascontiguousarray(rows[:, at : at + kind.itemsize]).view(kind.base)
        target = getattr(samples, quantity)
        target[:] = unit.read(values.astype(float) if kind.base.kind == "f" else values).reshape(target.shape)
    return samples


def reading(layout_of: Callable[[bytes], Layout]) -> Reading:
    """A function that reads self-describing frames; frames of one layout are read together."""

    def read(data: Bytes, found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        parts, events = list[Samples](), list[Event]()
        starts, sizes, _ = found
        while len(starts):
            same = sizes == sizes[0]
            rows = rows_of(data, starts[same], int(sizes[0]))
            layout = layout_of(rows[0].tobytes())
            equal = (rows[:, layout.describing] == rows[0, layout.describing]).all(axis=1)
            same[same] = equal
            stops = starts[same] + sizes[0] + offset
            if any(field.quantity == "force" for field in layout.fields):
                samples = filled(rows[equal], layout.fields)
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


def frames_of(samples: Samples, *parts: bytes | Field | NDArray) -> Bytes:
    """A frame for each sample, shape (n, size): constant bytes, fields, and columns of bytes or numbers in their own type."""
    columns = []
    for part in parts:
        if isinstance(part, Field):
            values = part.unit.write(np.nan_to_num(getattr(samples, part.quantity)))
            kind = np.dtype(part.kind).base
            if values.dtype.kind == "f" and kind.kind in "iu":
                values = np.rint(values).clip(np.iinfo(kind).min, np.iinfo(kind).max)
            part = values.astype(kind)
        elif isinstance(part, bytes):
            part = np.frombuffer(part * len(samples), np.uint8)
        columns.append(np.ascontiguousarray(part).view(np.uint8).reshape(len(samples), -1))
    return np.hstack(columns)
