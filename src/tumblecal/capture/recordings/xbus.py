"""Xsens (Movella) .mtb files and other logs of whole Xbus messages: a table for each device, by its bus identifier.

A log begins with the messages that state the configuration; the samples are MTData2 messages (`capture.protocols.xsens`).
SampleTimeFine counts steps of 0.1 ms. MT Low-Level Communication Protocol Documentation, section 4.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.framing import Found, decoded_by_layout
from tumblecal.capture.decoding.samples import Samples
from tumblecal.capture.protocols.xsens import MTDATA2, layout_of, no_force_words, numbers, samples_of
from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.table import Reader, SourceTable, of_arrays
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError


_PREAMBLE, _EXTENDED, _MASTER = 0xFA, 0xFF, 0xFF
_SAMPLE_TIME_FINE, _TICKS_PER_S = 0x1060, 1e4
_FEWEST = 3
_Layout = list[tuple[int, int, int]]


def _message_at(log: bytes, at: int) -> int:
    """The size of the message at this place; 0 if there is none with a correct checksum."""
    if at + 5 > len(log) or log[at] != _PREAMBLE:
        return 0
    short = log[at + 3]
    size = 5 + short if short != _EXTENDED else 7 + int.from_bytes(log[at + 4 : at + 6], "big")
    return size if at + size <= len(log) and sum(log[at + 1 : at + size]) % 256 == 0 else 0


def _messages(log: bytes) -> tuple[list[tuple[int, int]], int, int]:
    """Place and size of each message, the number of bytes outside messages, and the first of these."""
    found, at, skipped, first = list[tuple[int, int]](), 0, 0, -1
    while at < len(log):
        if size := _message_at(log, at):
            found.append((at, size))
            at += size
            continue
        following = log.find(bytes([_PREAMBLE]), at + 1)
        following = following if following >= 0 else len(log)
        first = at if first < 0 else first
        skipped, at = skipped + following - at, following
    return found, skipped, first


def _read(path: Path, options: RecordingOptions, damage: Damage) -> list[SourceTable]:
    log = path.read_bytes()
    found, skipped, first = _messages(log)
    if skipped:
        damage.report(
            f"{counted(skipped, 'byte')} outside messages with a correct sum, the first at byte {first}: left out"
        )
    data = np.frombuffer(log, np.uint8)
    places = np.array(found, np.int64).reshape(-1, 2)
    places = places[data[places[:, 0] + 2] == MTDATA2]
    tables, refused = list[SourceTable](), dict[str, None]()
    for bus in dict.fromkeys(data[places[:, 0] + 1].tolist()):
        own = places[data[places[:, 0] + 1] == bus]
        samples, ticks = _decoded(data, own, refused)
        good = samples.status == 0
        if not good.any():
            continue
        if flagged := int((~good).sum()):
            damage.report(f"{counted(flagged, 'sample')} marked as faulty by the device, or without a number: left out")
        columns = _columns(samples, ticks, good)
        name = "" if bus == _MASTER else f"bus {bus}"
        tables.append(of_arrays(name, columns, roles={own: own for own in columns}, row_word="sample"))
    if not tables:
        why = next(iter(refused), "no MTData2 message has a specific force")
        raise InputError(f"{path}: {why}")
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
    columns = {f"a{axis}_g": samples.force[good, k] for k, axis in enumerate("xyz")}
    if np.isfinite(samples.rate[good]).any():
        columns |= {f"g{axis}_dps": samples.rate[good, k] for k, axis in enumerate("xyz")}
    if np.isfinite(samples.temperature[good]).any():
        columns["temperature_degc"] = samples.temperature[good]
    if np.isfinite(ticks).all():
        # The counter of 32 bits overflows after five days.
        steps = np.diff(ticks) + np.where(np.diff(ticks) < -(2.0**31), 2.0**32, 0.0)
        times = (ticks[0] + np.concatenate([[0.0], np.cumsum(steps)])) / _TICKS_PER_S
        columns = {"time_s": times[good], **columns}
    return columns


def _recognised(path: Path, head: bytes) -> bool:
    """Whether a file begins with contiguous messages; the last may extend beyond the head."""
    at, count = 0, 0
    while count < _FEWEST and (size := _message_at(head, at)):
        at, count = at + size, count + 1
    return count == _FEWEST or (
        count > 0 and head[at : at + 1] == bytes([_PREAMBLE]) and at + (1 << 15) > len(head) > at
    )


READER = Reader("Xsens .mtb (Xbus messages)", _recognised, _read)
