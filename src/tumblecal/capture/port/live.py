"""The stream for the guide: new samples with their stamps and places in the log, and all faults."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.frame_numbers import FrameNumbers
from tumblecal.capture.decoding.losses import commonest_step
from tumblecal.capture.decoding.samples import Counts, Event, Samples, Settings, Status, joined
from tumblecal.capture.log import RecordKind
from tumblecal.capture.port.recording import Recording
from tumblecal.capture.protocols import Protocol


# Number of samples from which the step of the counter is estimated.
_ENOUGH_FOR_STEP = 8


@dataclass(frozen=True)
class Arrived:
    """New samples: `host_s` stamp of the read that completed each, `log_start` and `log_stop` of its record."""

    samples: Samples
    host_s: NDArray[np.float64]
    log_start: NDArray[np.int64]
    log_stop: NDArray[np.int64]
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
    restarts: int = 0
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
        counts = {name: value for name, value in vars(self).items() if name not in ("counts", "restarts")}
        rounded = {"status": dict(self.status), "longest_gap_s": round(self.longest_gap_s, 3)}
        return vars(self.counts) | counts | rounded | {"device_restarts": self.restarts}


class LiveStream:
    """Follows a recording and decodes it.

    **Arguments:**

    - `recording`: the running recorder.
    - `protocol`: protocol of the device.
    - `settings`: range and rate, if the stream does not state them.
    - `options`: further arguments of the decoder.
    """

    recording: Recording
    protocol: Protocol
    tally: Tally
    recent: bytes

    def __init__(self, recording: Recording, protocol: Protocol, settings: Settings | None, options: dict[str, Any]):
        self.recording, self.protocol = recording, protocol
        self._decoder = protocol.decoder(settings, **options)
        self.tally = Tally()
        self.recent = b""
        self._byte_stop: list[int] = []
        self._records: list[tuple[int, int, float]] = []
        self._bytes = 0
        self._frames: FrameNumbers | None = None
        self._early: list[Samples] = []
        self._last_stamp_s: float | None = None
        self._starting = False

    def poll(self) -> Arrived:
        """The samples since the last call."""
        return self._arrived(self.recording.poll())

    def stop(self) -> Arrived:
        """End the recorder and return the remaining samples."""
        return self._arrived(self.recording.stop())

    def _arrived(self, records: list) -> Arrived:
        data, notices = [], []
        for record in records:
            if record.kind == RecordKind.EVENT:
                notices.append(self._noticed(record.content()))
                continue
            stamp = record.stamp_ns * 1e-9
            data.append(record.payload)
            self._bytes += len(record.payload)
            self._byte_stop.append(self._bytes)
            self._records.append((record.offset, record.stop, stamp))
            if self._last_stamp_s is not None:
                self.tally.longest_gap_s = max(self.tally.longest_gap_s, stamp - self._last_stamp_s)
            self._last_stamp_s = stamp
        raw = b"".join(data)
        self.recent = (self.recent + raw)[-65536:]
        self.tally.bytes += len(raw)
        decoded = self._decoder.feed(raw)
        self.tally.counts.add(decoded.counts)
        samples = decoded.samples
        self._count(samples, [event.stop for event in decoded.events if event.counted])
        if not len(samples):
            none = np.zeros(0, np.int64)
            return Arrived(samples, np.zeros(0), none, none, decoded.events, notices)
        which = np.searchsorted(self._byte_stop, samples.stop)
        start, stop, stamp_s = np.array(self._records)[which].T
        arrived = Arrived(samples, stamp_s, start.astype(np.int64), stop.astype(np.int64), decoded.events, notices)
        self._byte_stop, self._records = self._byte_stop[which[-1] :], self._records[which[-1] :]
        return arrived

    def _noticed(self, event: dict) -> dict:
        match event["event"]:
            case "reopened":
                self.tally.reopened += 1
            case "silence":
                self.tally.silences += 1
        return event

    def _count(self, samples: Samples, replies: list[int]) -> None:
        for flag in Status:
            hits = int((samples.status & flag).astype(bool).sum())
            if hits:
                self.tally.status[str(flag.name).lower()] += hits
        starting = (samples.status & Status.STARTING).astype(bool)
        restarted = starting & ~np.concatenate([[self._starting], starting[:-1]])[: len(starting)]
        if len(starting):
            self.tally.restarts += int(restarted.sum()) if self._frames is not None else 0
            self._starting = bool(starting[-1])
        counter = self.protocol.counter
        if counter is None or not len(samples) or samples.counter[0] < 0:
            return
        if self._frames is None:
            self._early.append(samples)
            samples = joined(self._early)
            if len(samples) < _ENOUGH_FOR_STEP:
                return
            self._frames = FrameNumbers(counter.modulus, commonest_step(samples.counter, counter.modulus))
            restarted = np.zeros(len(samples), bool)
        places = np.searchsorted(samples.stop, np.array(replies, np.int64))
        self._frames.take(samples.counter, samples.content, restarted, places)
        self.tally.lost_at_least = self._frames.lost
        self.tally.duplicates = self._frames.repeats


def collected(parts: list[Arrived]) -> tuple[Samples, NDArray[np.float64]]:
    """Samples and stamps of several polls together."""
    return joined([p.samples for p in parts]), np.concatenate([np.zeros(0), *(p.host_s for p in parts)])
