"""The journal of a capture: append-only, and the only record of its state, which is recovered by reading the journal again.

A position is prompted, settles, is recorded, and is accepted or rejected; an accepted one may be withdrawn (redo).
Attempts are numbered and never overwritten.
"""

import contextlib
import hashlib
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tumblecal.capture.decoding.samples import Entry
from tumblecal.capture.log import LogWriter, RecordKind, read_log
from tumblecal.ground.errors import InputError


JOURNAL_NAME = "journal.log"
RAW_NAME = "raw.log"
PLAN_NAME = "plan.toml"


@dataclass(frozen=True)
class Attempt:
    """One accepted recording of a position: a stretch of the raw log.

    **Arguments:**

    - `position`: index in the plan. `number`: number of the attempt.
    - `log_start`, `log_stop`: its records in the raw log. `sha256`: SHA-256 of these bytes. `log_before`: start of the records
      just before it.
    - `summary`: means and checks as shown to the operator.
    - `wall_ns`: time of its end. `clocks`: the machine's clocks at this time, by `recorder.clocks`; missing in older journals.
    - `serial_number`: serial number of the instrument, if stated since its line was connected; otherwise None.
    """

    position: int
    number: int
    log_start: int
    log_stop: int
    sha256: str
    summary: Entry
    wall_ns: int
    log_before: int = 0
    clocks: Entry = field(default_factory=dict)
    serial_number: str | None = None


@dataclass
class RunState:
    """The state of a run; changed by `apply` only.

    **Arguments:**

    - `accepted`: the valid attempt, per position.
    - `attempts`: number of attempts, per position.
    - `skipped`: postponed positions. `postponed`: numbers of postponed soaks.
    - `session`: the entry that began the run. `devices`: the entries about the device, one for each start of the recording.
    - `to_confirm`: whether the instrument may be different, so that the operator must confirm it first.
    - `doubts`: entries on an instrument that was not confirmed, and on its confirmation.
    - `temperature_options`: options of the command about soaks and the chamber, the last of each.
    """

    accepted: dict[int, Attempt] = field(default_factory=dict)
    attempts: dict[int, int] = field(default_factory=dict)
    skipped: set[int] = field(default_factory=set)
    postponed: set[int] = field(default_factory=set)
    session: Entry = field(default_factory=dict)
    devices: list[Entry] = field(default_factory=list)
    to_confirm: bool = False
    doubts: list[Entry] = field(default_factory=list)
    temperature_options: Entry = field(default_factory=dict)

    @property
    def device(self) -> Entry:
        """The last entry about the device; empty if there is none."""
        return self.devices[-1] if self.devices else {}

    @property
    def serial_number(self) -> str | None:
        """The first serial number that the run's instrument stated; None if it never did."""
        return next((device["serial_number"] for device in self.devices if device.get("serial_number")), None)

    def stated(self, kind: str) -> Entry:
        """The content of the last event of this kind that the instrument sent before a recording; empty for none."""
        events = [event for device in self.devices for event in device.get("events", []) if event["kind"] == kind]
        return events[-1] if events else {}

    @property
    def configuration(self) -> Entry | None:
        """The settings that the instrument stated last, if it did."""
        return self.stated("configuration") or None

    @property
    def last_accepted(self) -> Attempt | None:
        """The position that was finished last."""
        return max(self.accepted.values(), key=lambda attempt: attempt.wall_ns, default=None)

    def apply(self, entry: Entry) -> None:
        """Change the state by the next entry of the journal."""
        position = entry.get("position", -1)  # only the entries about a position have one
        match kind := entry["entry"]:
            case "session":
                self.session = entry
            case "device":
                self.devices.append(entry)
                self.to_confirm &= not entry.get("serial_number")
            case "identity_not_confirmed" | "identity_confirmed" | "identity_trusted":
                self.doubts.append(entry)
                self.to_confirm = kind == "identity_not_confirmed" and bool(self.accepted)
            case "recording":
                self.attempts[position] = entry["attempt"]
            case "accepted":
                known = {name: value for name, value in entry.items() if name in Attempt.__dataclass_fields__}
                self.accepted[position] = Attempt(number=entry["attempt"], **known)
                self.skipped.discard(position)
            case "withdrawn":
                self.accepted.pop(position, None)
            case "skipped":
                self.skipped.add(position)
            case "soak_postponed":
                self.postponed.add(entry["soak"])
            case "temperature_options":
                self.temperature_options |= entry["options"]

    def open_after(self, position: int, soaks: Sequence[int]) -> int | None:
        """The next position that is not done, after this one, then from the start; None if all are done.

        `soaks` are the soaks of all positions: those of the present soak come first, and postponed soaks last. Within a soak,
        skipped positions come last.
        """
        here, count, most = soaks[max(position, 0)], len(soaks), max(soaks) + 1

        def order(k: int) -> tuple[bool, int, bool, int]:
            return soaks[k] in self.postponed, (soaks[k] - here) % most, k in self.skipped, (k - position - 1) % count

        return min((k for k in range(count) if k not in self.accepted), key=order, default=None)


def replayed(entries: Iterable[Entry]) -> RunState:
    """The state of the run after these entries; a session that begins again after one without a device replaces it."""
    state = RunState()
    for entry in entries:
        if entry["entry"] == "session":
            state = RunState()
        state.apply(entry)
    return state


def read_journal(folder: Path, faults: list[str] | None = None) -> list[Entry]:
    """All entries of a capture's journal.

    **Arguments:**

    - `faults`: receives a line for each stretch of the journal without an entry.

    **Raises:** `InputError` if there is no journal.
    """
    path = folder / JOURNAL_NAME
    if not path.is_file():
        raise InputError(
            f"{folder}: no {JOURNAL_NAME} here; give the folder of a capture (`tumblecal capture PLAN --out DIR`)"
        )
    entries = _entries(path, faults)
    if not entries or entries[0]["entry"] != "session":
        raise InputError(f"{path}: contains no capture; it may have been ended before the first entry")
    return entries


def _entries(path: Path, faults: list[str] | None) -> list[Entry]:
    return [record.content() for record in read_log(path, faults=faults) if record.kind == RecordKind.JOURNAL]


class Journal:
    """Writes entries, each to the disk before the call returns. While it is open, no other process can open it.

    **Arguments:**

    - `folder`: the capture's folder.

    `state`: of the run after all entries. `damage`: a line for each stretch of the journal without an entry.

    **Raises:** `InputError` if another capture has it open.
    """

    def __init__(self, folder: Path):
        self._writer, self.damage = LogWriter(folder / JOURNAL_NAME), list[str]()
        try:
            self.state = replayed(_entries(self._writer.path, self.damage))
        except BaseException:
            self.close()
            raise

    def write(self, entry: str, **content: object) -> None:
        """Add an entry, and apply it to the state.

        **Raises:** `InputError` if the disk is full or fails, or the journal was deleted or moved.
        """
        full = {"entry": entry, "wall_ns": time.time_ns(), **content}
        self._writer.append_json(RecordKind.JOURNAL, full, time.monotonic_ns())
        self.state.apply(full)
        self.check()

    def check(self) -> None:
        """Raise `InputError` if the journal was deleted or moved, or its folder can no longer be written."""
        self._writer.check()

    def close(self) -> None:
        """Release the journal for other processes."""
        with contextlib.suppress(InputError):
            self._writer.close()


def sha256_of(path: Path, start: int = 0, stop: int | None = None) -> str:
    """SHA-256 of a file, or of a stretch of it.

    **Raises:** `InputError` if it cannot be read.
    """
    try:
        with path.open("rb") as file:
            file.seek(start)
            return (
                hashlib.file_digest(file, "sha256") if stop is None else hashlib.sha256(file.read(stop - start))
            ).hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
