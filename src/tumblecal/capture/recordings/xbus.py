"""Xsens (Movella) .mtb files and other logs of whole Xbus messages: a table for each device, by its bus identifier.

A log begins with the messages that state the configuration; the samples are MTData2 messages (`capture.protocols.xsens`).
SampleTimeFine counts steps of 0.1 ms. MT Low-Level Communication Protocol Documentation, section 4.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.framing import Found, decoded_by_layout
from tumblecal.capture.decoding.sample_table import columns_of, table_of
from tumblecal.capture.decoding.samples import Samples
from tumblecal.capture.protocols.xsens import MTDATA2, layout_of, messages_in, no_force_words, numbers, samples_of
from tumblecal.capture.recordings.table import Reader, Source, SourceTable, of_arrays
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError


_PREAMBLE, _MASTER = b"\xfa", 0xFF
_SAMPLE_TIME_FINE, _TICKS_PER_S = 0x1060, 1e4
_FEWEST = 3
_Layout = list[tuple[int, int, int]]


def _read(source: Source) -> list[SourceTable]:
    data = np.fromfile(source.path, np.uint8)
    found = messages_in(data, _PREAMBLE, final=True)
    begins, ends = np.append(found.starts, len(data)), np.append(0, found.starts + found.sizes)
    if skipped := int((begins - ends).sum()):
        first = int(ends[np.argmax(begins > ends)])
        source.damage.report(
            f"{counted(skipped, 'byte')} outside messages with a correct sum, the first at byte {first}: left out"
        )
    places = np.stack([found.starts, found.sizes], axis=1)
    places = places[data[places[:, 0] + 2] == MTDATA2]
    tables, refused = list[SourceTable](), dict[str, None]()
    for bus in dict.fromkeys(data[places[:, 0] + 1].tolist()):
        samples, ticks = _decoded(data, places[data[places[:, 0] + 1] == bus], refused)
        good = samples.status == 0
        if not good.any():
            continue
        if flagged := int((~good).sum()):
            source.damage.report(
                f"{counted(flagged, 'sample')} marked as faulty by the device, or without a number: left out"
            )
        columns = _columns(samples, ticks, good)
        name = "" if bus == _MASTER else f"bus {bus}"
        tables.append(of_arrays(name, columns, roles={role: role for role in columns}, row_word="sample"))
    if not tables:
        why = next(iter(refused), "no MTData2 message has a specific force")
        raise InputError(f"{source.path}: {why}")
    return tables


def _decoded(
    data: NDArray[np.uint8], places: NDArray[np.int64], refused: dict[str, None]
) -> tuple[Samples, NDArray[np.float64]]:
    """The samples of messages, and their SampleTimeFine; NaN if not stated."""
    ticks: dict[int, float] = {}

    def decode(starts: NDArray[np.int64], size: int, layout: _Layout) -> Samples | None:
        samples = samples_of(data, starts, layout)
        if samples is None:
            if why := no_force_words(layout):
                refused[why] = None
            return None
        for identifier, at, length in layout:
            if identifier & 0xFFF0 == _SAMPLE_TIME_FINE and length == 4:
                stated = numbers(identifier, data[(starts + at)[:, None] + np.arange(length)])[:, 0]
                ticks.update(zip((starts + size).tolist(), stated.tolist(), strict=True))
        return samples

    found = Found(places[:, 0], places[:, 1], len(data))
    samples = decoded_by_layout(data, found, 0, layout_of, decode)
    return samples, np.array([ticks.get(stop, np.nan) for stop in samples.stop.tolist()])


def _columns(samples: Samples, ticks: NDArray[np.float64], good: NDArray[np.bool_]) -> dict[str, NDArray[np.float64]]:
    columns = table_of(samples[good], columns_of(samples[good]))
    del columns["counter"], columns["status"]
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
