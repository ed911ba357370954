"""The output of every decoder: samples in stream order, events, and counts of faults."""

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from enum import IntFlag
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.ground.plain_text import plain


Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


# Content of an event, of an entry of the journal, or of a datagram.
Entry = dict[str, Any]


class Status(IntFlag):
    """Status of one sample as the device states it; zero means good."""

    STARTING = 1
    OVERLOAD = 2
    ERROR = 4
    OUTSIDE_CONDITIONS = 8
    NOT_A_NUMBER = 16


class Samples(np.recarray):
    """Samples in stream order: an array of n records.

    **Arguments:**

    - `stop`: place in the byte stream just after the frame, shape (n,).
    - `force`: specific force in standard g (9.80665 m/s^2), shape (n, 3); NaN while the device's range is unknown.
    - `rate`: angular rate in deg/s, shape (n, 3); NaN if not sent.
    - `temperature`: degC, shape (n,); NaN if not sent.
    - `counter`: the device's counter as sent, shape (n,); -1 if there is none.
    - `status`: `Status` bits, shape (n,).
    - `clock`: the device's clock as sent, in any unit of time, shape (n,); NaN if not sent.
    """

    if TYPE_CHECKING:

        def __getitem__(self, rows: Any) -> "Samples": ...  # type: ignore[override]


_SAMPLE = np.dtype(
    [
        ("stop", "i8"),
        ("force", "f8", 3),
        ("rate", "f8", 3),
        ("temperature", "f8"),
        ("counter", "i8"),
        ("status", "u1"),
        ("clock", "f8"),
    ],
    align=True,
)
_EMPTY = np.array([(0, np.nan, np.nan, np.nan, -1, 0, np.nan)], _SAMPLE)


def blank(n: int) -> Samples:
    """`n` empty samples: NaN values, no counter, status zero."""
    return _EMPTY.repeat(n).view(Samples)


def joined(parts: Iterable[Samples]) -> Samples:
    """Concatenate samples."""
    parts = [part for part in parts if len(part)]
    return parts[0] if len(parts) == 1 else np.concatenate([blank(0), *parts]).view(Samples)


def samples_of(rows: list[tuple]) -> Samples:
    """Samples from their values one after the other; those without a number are flagged."""
    samples = np.array(rows, _SAMPLE).view(Samples)
    samples.status[:] = not_a_number(samples.force)
    return samples


def usable(samples: Samples) -> Mask:
    """Whether samples have no status bit and a finite specific force, shape (n,)."""
    return (samples.status == 0) & (not_a_number(samples.force) == 0)


def not_a_number(force: Floats) -> Bytes:
    """The status of samples by their specific force (n, 3) alone, shape (n,)."""
    # By component: several times faster than by sample.
    return ~np.logical_and.reduce([np.isfinite(component) for component in force.T]) * np.uint8(Status.NOT_A_NUMBER)


@dataclass(frozen=True)
class Event:
    """Something in the stream that is not a sample: a reply, a configuration, an error message.

    **Arguments:**

    - `stop`: place in the byte stream just after it.
    - `kind`: "serial_number", "part_number", "configuration", "error", "layout", "reply"; "other_message": not a sample, but it
      uses a number of the counter; "refused": complete and valid, but not read, with the reason in its text.
    - `content`: its contents.
    """

    stop: int
    kind: str
    content: Entry

    def __post_init__(self) -> None:
        # A device may send any text, and all of it is shown and recorded.
        texts = {key: plain(value) for key, value in self.content.items() if isinstance(value, str)}
        object.__setattr__(self, "content", self.content | texts)

    @property
    def counted(self) -> bool:
        """Whether it used a number of the device's counter instead of a sample."""
        return self.kind not in ("layout", "refused", "reply")


@dataclass
class Counts:
    """Counts of a decoder: all of them are shown, nothing is dropped silently.

    `frames`: complete frames with samples; `special`: complete frames without; `check_failures`: frames in their place with a
    wrong checksum; `resyncs`: losses and recoveries of the frame boundary; `discarded`: bytes outside complete frames.
    """

    frames: int = 0
    special: int = 0
    check_failures: int = 0
    resyncs: int = 0
    discarded: int = 0

    def add(self, other: "Counts") -> None:
        """Add the counts of a later stretch."""
        for f in fields(self):
            setattr(self, f.name, getattr(self, f.name) + getattr(other, f.name))


@dataclass(frozen=True)
class Decoded:
    """One stretch of the stream, decoded."""

    samples: Samples
    events: list[Event] = field(default_factory=list)
    counts: Counts = field(default_factory=Counts)


@dataclass(frozen=True)
class Stated:
    """Settings of a device that its stream does not state.

    Parameters
    ----------
    range_g
        Full scale in g, if the stream does not state it. Default: none. Example: --range-g 10.
    rate_hz
        Sample rate in Hz for the column of times, if the stream does not state it. Default: none. Example: --rate-hz 100.
    columns
        For lines of text: quantity of each column (ax, ay, az, gx, gy, gz, t, counter, time, or - for an unused one).
        Default: as in the header line. Example: --columns time,ax,ay,az,-.
    unit
        For lines of text: unit of the accelerations: g, mg, m/s2, or counts for one g. Default: as in the header line,
        otherwise guessed from their size.
        Example: --unit 'LSB 16384/g'.
    """

    range_g: float | None = None
    rate_hz: float | None = None
    columns: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Settings:
    """Settings of a device that are needed to read its output and are not in the samples.

    **Arguments:**

    - `range_g`: full scale of the accelerometers in g, per axis; None if unknown.
    - `output`: "acceleration" (g or m/s^2), "increment" (velocity a sample), "average" or "integrated".
    - `rate_hz`: configured sample rate; None if the stream must state it.
    - `temperatures`: whether a virtual STIM300 sends temperatures.
    - `columns`, `unit`: for lines of text, quantity of each column, and unit of the specific force; empty: of a header line.
    - `whole`: the stream is complete from its first byte (a file); a port opens within a line or frame.
    """

    range_g: tuple[float, float, float] | None = None
    output: str = "acceleration"
    rate_hz: float | None = None
    temperatures: bool = False
    columns: str = ""
    unit: str = ""
    whole: bool = False


UNKNOWN = Settings()
