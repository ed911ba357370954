"""What every protocol decodes to: samples in stream order, events beside them, and counts of what went wrong."""

from dataclasses import dataclass, field, fields
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from tumblecal.ground.plain_text import plain


class Status(IntFlag):
    """What a device says about one sample; zero means good."""

    STARTING = 1
    OVERLOAD = 2
    ERROR = 4
    OUTSIDE_CONDITIONS = 8
    NOT_A_NUMBER = 16


@dataclass(frozen=True)
class Samples:
    """Samples in stream order; arrays of n rows.

    **Arguments:**

    - `stop`: place in the byte stream just after the frame, shape (n,).
    - `force`: specific force in standard g (9.80665 m/s^2), shape (n, 3); NaN while the device's range is not known.
    - `rate`: angular rate in deg/s, shape (n, 3); NaN where not sent.
    - `temperature`: degC, shape (n,); NaN where not sent.
    - `counter`: the device's own counter as sent, shape (n,); -1 where there is none.
    - `status`: `Status` bits, shape (n,).
    """

    stop: NDArray[np.int64]
    force: NDArray[np.float64]
    rate: NDArray[np.float64]
    temperature: NDArray[np.float64]
    counter: NDArray[np.int64]
    status: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.stop)

    def content(self, rows: slice) -> NDArray[np.float64]:
        """All that frames contain in addition to their counter, shape (n, 8): with the same counter it makes the same frame."""
        of = self[rows]
        return np.column_stack([of.force, of.rate, of.temperature, of.status.astype(np.float64)])

    def __getitem__(self, rows: slice | NDArray) -> "Samples":
        return Samples(*(getattr(self, f.name)[rows] for f in fields(self)))


def not_a_number(force: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The status of samples by their specific force alone."""
    return np.where(np.isfinite(force).all(1), 0, Status.NOT_A_NUMBER).astype(np.uint8)


def blank(n: int) -> Samples:
    """`n` samples with nothing known: NaN values, no counter, status zero."""
    return Samples(
        stop=np.zeros(n, np.int64),
        force=np.full((n, 3), np.nan),
        rate=np.full((n, 3), np.nan),
        temperature=np.full(n, np.nan),
        counter=np.full(n, -1, np.int64),
        status=np.zeros(n, np.uint8),
    )


def joined(parts: list[Samples]) -> Samples:
    """One after the other."""
    if not parts:
        return blank(0)
    if len(parts) == 1:
        return parts[0]
    return Samples(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Samples)))


@dataclass(frozen=True)
class Event:
    """Something in the stream that is not a sample: a reply, a configuration, an error message.

    **Arguments:**

    - `stop`: place in the byte stream just after it.
    - `kind`: "serial_number", "part_number", "configuration", "error", "layout", "reply"; "other_message": no sample, but
      it takes a number of the counter; "refused": whole and right, but not read, as its text says.
    - `content`: what it says.
    """

    stop: int
    kind: str
    content: dict

    def __post_init__(self) -> None:
        # A device may say anything, and all of it is shown and written down.
        texts = {key: plain(value) for key, value in self.content.items() if isinstance(value, str)}
        object.__setattr__(self, "content", self.content | texts)

    @property
    def counted(self) -> bool:
        """Whether it took a number of the device's counter in place of a sample."""
        return self.kind not in ("layout", "refused", "reply")


@dataclass
class Counts:
    """What a decoder met: all of it is shown, nothing is dropped silently.

    `frames` whole frames with samples; `special` whole frames without; `check_failures` frames in their place whose
    check is wrong; `resyncs` times the frame boundary was lost and found; `discarded` bytes outside whole frames.
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
    """What a user says of a stream that does not tell it.

    Parameters
    ----------
    range_g
        Full scale in g, where the stream does not tell it.
    rate_hz
        Sample rate in Hz, where the stream does not tell it; gives the time column.
    columns
        For text lines: role of each column (ax, ay, az, gx, gy, gz, t, counter, time, or - for one not used).
    unit
        For text lines: g, mg, m/s2 or e.g. "LSB 16384/g".
    """

    range_g: float | None = None
    rate_hz: float | None = None
    columns: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Settings:
    """What must be known of a device to scale its output, and cannot be seen in the samples themselves.

    **Arguments:**

    - `range_g`: full scale of the accelerometers in g, per axis; None when not known.
    - `output`: "acceleration" (g or m/s^2), "increment" (velocity a sample), "average" or "integrated".
    - `rate_hz`: configured sample rate; None when the stream must tell it.
    - `lsb_g`: smallest step per axis in g; None when not known.
    """

    range_g: tuple[float, float, float] | None = None
    output: str = "acceleration"
    rate_hz: float | None = None
    lsb_g: tuple[float, float, float] | None = None
