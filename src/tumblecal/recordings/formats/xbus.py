"""Xsens (Movella) .mtb files and other logs of whole Xbus messages: a table for each device, by its bus identifier.

A log begins with the messages that state the configuration; the samples are MTData2 messages (`capture.protocols.xsens`).
SampleTimeFine counts steps of 0.1 ms. MT Low-Level Communication Protocol Documentation, section 4.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.framing import Found, decoded_by_layout
from tumblecal.capture.decoding.sample_table import columns_of, table_of
from tumblecal.capture.decoding.samples import Samples, joined
from tumblecal.capture.protocols.xsens import MTDATA2, layout_of, messages_in, no_force_words, samples_of
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.recordings.table import Reader, Source, Table, of_arrays


_PREAMBLE, _MASTER = b"\xfa", 0xFF
_TICKS_PER_S = 1e4
_FEWEST = 3
# Bytes that are searched, and messages that are decoded, at once.
_PIECE, _BLOCK = 1 << 22, 1 << 16
_Layout = list[tuple[int, int, int]]


def _read(source: Source) -> list[Table]:
    data = np.memmap(source.path, np.uint8, "r")
    starts, sizes = _messages(data)
    begins, ends = np.append(starts, len(data)), np.append(0, starts + sizes)
    if skipped := int((begins - ends).sum()):
        first = int(ends[np.argmax(begins > ends)])
        source.damage.report(
            f"{counted(skipped, 'byte')} outside messages with a correct sum, the first at byte {first}: left out"
        )
    measured = data[starts + 2] == MTDATA2
    starts, sizes = starts[measured], sizes[measured]
    buses = data[starts + 1]
    tables, refused = list[Table](), dict[str, None]()
    for bus in dict.fromkeys(buses.tolist()):
        samples = _decoded(data, starts[buses == bus], sizes[buses == bus], refused)
        good = samples.status == 0
        if not good.any():
            continue
        if flagged := int((~good).sum()):
            source.damage.report(
                f"{counted(flagged, 'sample')} marked as faulty by the device, or without a number: left out"
            )
        columns = _columns(samples, good)
        name = "" if bus == _MASTER else f"bus {bus}"
        tables.append(of_arrays(name, columns, roles={role: role for role in columns}, row_word="sample"))
    if not tables:
        why = next(iter(refused), "no MTData2 message has a specific force")
        raise InputError(f"{source.path}: {why}")
    return tables


def _messages(data: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Starts and sizes of all messages; the file is searched in pieces."""
    parts, at = [(np.zeros(0, np.int64),) * 2], 0
    while at < len(data):
        last = at + _PIECE >= len(data)
        found = messages_in(data[at : at + _PIECE], _PREAMBLE, final=last)
        parts.append((found.starts + at, found.sizes))
        at = len(data) if last else at + max(found.limit, 1)
    starts, sizes = map(np.concatenate, zip(*parts, strict=True))
    return starts, sizes


def _decoded(
    data: NDArray[np.uint8], starts: NDArray[np.int64], sizes: NDArray[np.int64], refused: dict[str, None]
) -> Samples:
    """The samples of messages."""

    def decode(starts: NDArray[np.int64], size: int, layout: _Layout) -> Samples | None:
        samples = samples_of(data, starts, layout)
        if samples is None and (why := no_force_words(layout)):
            refused[why] = None
        return samples

    return joined(
        [
            decoded_by_layout(data, Found(starts[block], sizes[block], len(data)), 0, layout_of, decode)
            for first in range(0, len(starts), _BLOCK)
            for block in [slice(first, first + _BLOCK)]
        ]
    )


def _columns(samples: Samples, good: NDArray[np.bool_]) -> dict[str, NDArray[np.float64]]:
    columns = table_of(samples[good], columns_of(samples[good]))
    del columns["counter"], columns["status"]
    ticks = samples.clock
    if np.isfinite(ticks).all():
        # The counter of 32 bits overflows after five days.
        steps = np.diff(ticks) + np.where(np.diff(ticks) < -(2.0**31), 2.0**32, 0.0)
        times = (ticks[0] + np.concatenate([[0.0], np.cumsum(steps)])) / _TICKS_PER_S
        columns = {"time_s": times[good], **columns}
    return columns


def _recognised(path: Path, head: bytes) -> bool:
    """Whether a file begins with contiguous messages; the last may extend beyond the head."""
    found = messages_in(np.frombuffer(head, np.uint8), _PREAMBLE, final=True)
    ends = found.starts + found.sizes
    count = int(np.argmin(np.append(found.starts == np.append(0, ends)[:-1], False)))
    at = int(ends[count - 1]) if count else 0
    return count >= _FEWEST or (count > 0 and head[at : at + 1] == _PREAMBLE and at + (1 << 15) > len(head))


READER = Reader("Xsens .mtb (Xbus messages)", _recognised, _read)
