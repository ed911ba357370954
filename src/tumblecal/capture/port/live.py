"""The stream for the guide: new samples with their stamps and places in the log, and all faults."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tumblecal.capture.decoding.frame_numbers import CountedStream
from tumblecal.capture.decoding.samples import Counts, Event, Floats, Integers, Samples, Settings, Status, joined
from tumblecal.capture.log import Record, RecordKind
from tumblecal.capture.port.recording import Recording
from tumblecal.capture.protocols import Protocol


_RECENT_BYTES = 65536


@dataclass(frozen=True)
class Arrived:
    """New samples: `host_s` stamp of the read that completed each, `log_start` and `log_stop` of its record."""

    samples: Samples
    host_s: Floats
    log_start: Integers
    log_stop: Integers
    events: list[Event]
    notices: list[dict[str, Any]]


@dataclass
class Tally:
    """The live counts, all of them shown."""

    counts: Counts = field(default_factory=Counts)
    lost_at_least: int = 0
    duplicates: int = 0
    status: Counter[str] = field(default_factory=Counter)
    reopened: int = 0
    silences: int = 0
    device_restarts: int = 0
    longest_gap_s: float = 0.0
    bytes: int = 0

    def line(self) -> str:
        """The counts as text for the screen."""
        c, flags = self.counts, "".join(f", {name} {n}" for name, n in self.status.items())
        return (
            f"frames {c.frames}, bad checks {c.check_failures}, resyncs {c.resyncs}, "
            f"discarded bytes {c.discarded}, lost >= {self.lost_at_least}, reopened {self.reopened}{flags}"
        )

    def as_dict(self) -> dict[str, Any]:
        """The counts for the journal."""
        counts = {name: value for name, value in vars(self).items() if name != "counts"}
        return vars(self.counts) | counts | {"longest_gap_s": round(self.longest_gap_s, 3)}


class LiveStream:
    """Follows a recording and decodes it.

    **Arguments:**

    - `recording`: the running recorder.
    - `protocol`: protocol of the device.
    - `settings`: range and rate, if the stream does not state them.
    - `options`: further arguments of the decoder.
    """

    def __init__(self, recording: Recording, protocol: Protocol, settings: Settings | None, options: dict[str, Any]):
        self.recording, self.protocol = recording, protocol
        self._decoder, self._stream = protocol.decoder(settings, **options), CountedStream(protocol.counter)
        self.tally, self.recent = Tally(), b""
        # End in the stream, place in the log and stamp of the records whose samples are not complete.
        self._records = list[tuple[int, int, int, float]]()
        self._last_stamp_s: float | None = None

    def poll(self) -> Arrived:
        """The samples since the last call."""
        return self._arrived(self.recording.poll())

    def stop(self) -> Arrived:
        """End the recorder and return the remaining samples."""
        return self._arrived(self.recording.stop())

    def _arrived(self, records: list[Record]) -> Arrived:
        tally, raw, notices = self.tally, b"", list[dict[str, Any]]()
        for record in records:
            if record.kind == RecordKind.EVENT:
                notices.append(record.content())
                tally.reopened += notices[-1]["event"] == "reopened"
                tally.silences += notices[-1]["event"] == "silence"
                continue
            stamp_s = record.stamp_ns * 1e-9
            raw += record.payload
            tally.bytes += len(record.payload)
            self._records.append((tally.bytes, record.offset, record.stop, stamp_s))
            tally.longest_gap_s = max(tally.longest_gap_s, stamp_s - (self._last_stamp_s or stamp_s))
            self._last_stamp_s = stamp_s
        self.recent = (self.recent + raw)[-_RECENT_BYTES:]
        decoded = self._decoder.feed(raw)
        samples = decoded.samples
        tally.counts.add(decoded.counts)
        for flag in Status:
            if hits := int(np.count_nonzero(samples.status & flag)):
                tally.status[str(flag.name).lower()] += hits
        self._stream.add(decoded)
        if numbers := self._stream.numbers:
            tally.lost_at_least, tally.duplicates, tally.device_restarts = (
                numbers.lost,
                numbers.repeats,
                numbers.restarts,
            )
        ends, start, stop, stamp_s = np.array(self._records or np.zeros((0, 4))).T
        which = np.searchsorted(ends, samples.stop)
        self._records = self._records[which[-1] if len(which) else 0 :]
        places = start[which].astype(int), stop[which].astype(int)
        return Arrived(samples, stamp_s[which], *places, decoded.events, notices)


def collected(parts: list[Arrived]) -> tuple[Samples, Floats]:
    """Samples and stamps of several polls together."""
    return joined(p.samples for p in parts), np.concatenate([np.zeros(0), *(p.host_s for p in parts)])
