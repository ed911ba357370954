"""Xsens (Movella) .mtb files and other logs of whole Xbus messages: a table for each device, by its bus identifier.

A log begins with the messages that state the configuration; the samples are MTData2 messages (`capture.protocols.xsens`).
SampleTimeFine counts steps of 0.1 ms. MT Low-Level Communication Protocol Documentation, section 4.
"""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.fields import reading
from tumblecal.capture.decoding.framing import Found, find
from tumblecal.capture.decoding.sample_table import known_columns, table_of
from tumblecal.capture.decoding.samples import Floats, Samples, joined
from tumblecal.capture.protocols.xsens import MTDATA2, layout_of, messages
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.recordings.table import Reader, Source, Table, of_arrays


_MESSAGES, _MASTER, _FEWEST = (messages(b"\xfa"),), 0xFF, 3
_TICKS_PER_S = 1e4
# Messages that are decoded at once.
_BLOCK = 1 << 16


def _read(source: Source) -> list[Table]:
    data = np.memmap(source.path, np.uint8, "r")
    starts, sizes, _ = find(_MESSAGES, data, final=True)
    before = starts - np.append(0, starts + sizes)[:-1]
    if skipped := len(data) - int(sizes.sum()):
        first = int((starts - before)[before > 0][0]) if before.any() else int(sizes.sum())
        source.damage.report(
            f"{counted(skipped, 'byte')} outside messages with a correct sum, the first at byte {first}: left out"
        )
    measured = data[starts + 2] == MTDATA2
    starts, sizes = starts[measured], sizes[measured]
    tables, refused = list[Table](), list[str]()
    read = reading(layout_of)
    buses = data[starts + 1]
    for bus in dict.fromkeys(buses.tolist()):
        own = np.flatnonzero(buses == bus)
        blocks = [own[first : first + _BLOCK] for first in range(0, len(own), _BLOCK)]
        found = [Found(starts[block], sizes[block], len(data)) for block in blocks]
        decoded = [read(data, one, 0, True) for one in found]
        refused += [event.content["text"] for _, events in decoded for event in events if event.kind == "refused"]
        samples = joined([samples for samples, _ in decoded])
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


def _columns(samples: Samples, good: NDArray[np.bool_]) -> dict[str, Floats]:
    table = table_of(samples[good])
    columns = {name: table[name] for name in table if name in known_columns(table) - {"counter", "status"}}
    if not np.isfinite(samples.clock).all():
        return columns
    # The counter of 32 bits overflows after five days.
    steps = np.diff(samples.clock, prepend=0.0)
    ticks = np.cumsum(steps + np.where(steps < -(2.0**31), 2.0**32, 0.0))
    return {"time_s": ticks[good] / _TICKS_PER_S, **columns}


def _recognised(path: object, head: bytes) -> bool:
    """Whether a file begins with contiguous messages."""
    found = find(_MESSAGES, np.frombuffer(head, np.uint8), final=True)
    return (
        int((found.starts + found.sizes)[:_FEWEST][-1:].sum()) == int(found.sizes[:_FEWEST].sum())
        and len(found.sizes) >= _FEWEST
    )


READER = Reader("Xsens .mtb (Xbus messages)", _recognised, _read)
