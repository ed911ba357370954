"""The file of a history: SQLite with a write-ahead log. An entry is one transaction, on disk before `add` returns.

Several processes can write at the same time (each waits for the others). If one is killed, the earlier entries are unchanged.
"""

import contextlib
import hashlib
import json
import math
import os
import sqlite3
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.ground.errors import InputError
from tumblecal.ground.plain_text import plain
from tumblecal.ground.unwritable import reason
from tumblecal.history import checksums
from tumblecal.history.checksums import COLUMNS, PARAMETERS, ROW, checksum
from tumblecal.history.entry import Entry
from tumblecal.history.noise_of_entry import has_parts, of_noise


if TYPE_CHECKING:
    from tumblecal.data.sensor_parameters import SensorParameters

_APPLICATION, _VERSION = 0x54424C31, 1  # "TBL1", in the file's header
_PATIENCE_S = 60.0
_SCHEMA = """
CREATE TABLE entry (
    number INTEGER PRIMARY KEY, key TEXT NOT NULL UNIQUE, kind TEXT NOT NULL, serial TEXT NOT NULL,
    date_utc TEXT NOT NULL, source TEXT NOT NULL, sha256 TEXT NOT NULL, outcome TEXT NOT NULL, rms_g REAL, p_value REAL);
CREATE INDEX entry_of_unit ON entry (serial, date_utc);
CREATE TABLE parameters (
    number INTEGER PRIMARY KEY REFERENCES entry, names TEXT NOT NULL, estimate BLOB NOT NULL, covariance BLOB NOT NULL);
CREATE TABLE document (
    number INTEGER NOT NULL REFERENCES entry, name TEXT NOT NULL, content BLOB NOT NULL, PRIMARY KEY (number, name));
"""
_WITH_DOF = ("calibration.json", "result.json")  # documents with the degrees of freedom of the noise
_BUDGET = "budget.json"
_ENTRY = f"INSERT OR IGNORE INTO entry ({COLUMNS}) VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
_UNREADABLE = (ValueError, TypeError, KeyError, AttributeError, RecursionError, zlib.error)


def ready(path: Path) -> None:
    """Create the file if it is missing, and check that it is a history.

    **Raises:** `InputError` if it is not a history, or cannot be created.
    """
    with _open(path, new=True):
        pass


def add(path: Path, entry: Entry) -> bool:
    """Add an entry; an identical one is not added twice.

    **Returns:** whether it is new.

    **Raises:** `InputError` if the file cannot be written, or is not a history.
    """
    _, _, *columns = COLUMNS.split(", ")
    with _open(path, new=True) as database:
        database.execute("BEGIN IMMEDIATE")
        with database:  # commits, or rolls back
            checksums.ready(database)
            # The identity of an entry: its documents, or its date if it has none.
            content = [entry.kind, entry.serial, entry.source, entry.sha256, *sorted(entry.documents.items())]
            content += [] if entry.documents else [entry.date_utc]
            key = hashlib.sha256(json.dumps(content).encode()).hexdigest()
            added = database.execute(_ENTRY, (key, *(getattr(entry, name) for name in columns)))
            if not added.rowcount:
                return False
            number, parameters = added.lastrowid or 0, entry.parameters
            if parameters is not None:
                arrays = (parameters.values.astype("<f8").tobytes(), parameters.covariance.astype("<f8").tobytes())
                row = (number, json.dumps(parameters.names), *arrays)
                database.execute("INSERT INTO parameters VALUES (?, ?, ?, ?)", row)
            for name, text in entry.documents.items():
                packed = zlib.compress(text.encode("utf-8", "replace"))
                database.execute("INSERT INTO document VALUES (?, ?, ?)", (number, name, packed))
            checksums.state(database, number)
        return True


def listed(path: Path, serial: str | None = None) -> list[Entry]:
    """All entries, or those of a unit, in order of date, without parameters and documents.

    An entry with a damaged row is marked (`damaged`), and belongs to no unit.
    """
    with _open(path) as database:
        stated = "checksum.sha256" if checksums.has_checksums(database) else "NULL"
        join = f"LEFT JOIN checksum ON checksum.number = entry.number AND part = '{ROW}'" if stated != "NULL" else ""
        columns = ", ".join(f"entry.{name.strip()}" for name in COLUMNS.split(","))
        entries = [_entry(*row) for row in _rows(database, f"SELECT {columns}, {stated} FROM entry {join}")]
    chosen = entries if serial is None else [e for e in entries if e.serial == serial and not e.damaged]
    return sorted(chosen, key=lambda entry: (entry.date_utc, entry.number))


def of_unit(path: Path, serial: str) -> list[Entry]:
    """The entries of a unit with their parameters, in order of date; an entry with a damaged part is marked and has none."""
    entries = listed(path, serial)
    with _open(path) as database:
        return [_with_parameters(database, entry) for entry in entries]


def documents(path: Path, number: int) -> dict[str, str]:
    """The files of an entry, except damaged ones."""
    with _open(path) as database:
        damaged = checksums.damaged_parts(database, number)
        names = checksums.document_names(database, number)
        return _packed(database, number, [name for name in names if name not in damaged])


def damaged_documents(path: Path, number: int) -> list[str]:
    """The names of damaged or missing files of an entry."""
    with _open(path) as database:
        if number not in checksums.numbers(database):
            return []
        return [part for part in checksums.damaged_parts(database, number) if part not in (ROW, PARAMETERS)]


def checked(path: Path) -> tuple[list[Entry], list[str]]:
    """All entries with their damaged parts (`damaged`), and the faults of the file that SQLite finds.

    **Raises:** `InputError` if the file cannot be opened as a history.
    """
    entries = {entry.number: entry for entry in listed(path)}
    with _open(path) as database:
        faults = list(checksums.faults(database))
        for number in checksums.numbers(database):
            parts = checksums.damaged_parts(database, number)
            entry = entries.get(number) or Entry("", "", "", "", "", "", number=number, damaged=ROW)
            parts = [entry.damaged] * (entry.damaged not in ("", *parts)) + parts
            try:
                whole = _with_parameters(database, replace(entry, damaged="")).damaged
            except sqlite3.DatabaseError:
                whole = PARAMETERS
            parts += [whole] if whole and not parts else []
            entries[number] = replace(entry, damaged=", ".join(parts))
    return sorted(entries.values(), key=lambda entry: (entry.date_utc, entry.number)), faults


def _rows(database: sqlite3.Connection, query: str) -> Iterator[Sequence]:
    """The rows of a query on entries; if a page of the file is damaged, those that can be read separately."""
    try:
        yield from database.execute(query).fetchall()
    except sqlite3.DatabaseError as damage:
        found = False
        for number in checksums.numbers(database):
            with contextlib.suppress(sqlite3.DatabaseError):
                for row in database.execute(f"{query} WHERE entry.number = ?", (number,)).fetchall():
                    found = True
                    yield row
        if not found:
            raise damage


def _entry(*row) -> Entry:
    """The entry of a row; if damaged, it is marked, and keeps a valid date."""
    number, _, *values, stated = row
    texts, sizes = values[:6], values[6:]
    good = all(isinstance(text, str) for text in texts)
    good &= all(size is None or (isinstance(size, float | int) and math.isfinite(size)) for size in sizes)
    good &= stated is None or checksum(ROW, row[:-1]) == stated
    kind, serial, date_utc, source, sha256, outcome = [plain(str(text)) for text in texts]
    rms_g, p_value = sizes if good else (None, None)
    entry = Entry(
        kind, serial, date_utc, source, sha256, outcome, rms_g, p_value, number=number, damaged="" if good else ROW
    )
    if (stated is None or not good) and not entry.dated:
        return replace(entry, damaged=ROW, date_utc="")
    return entry


def _with_parameters(database: sqlite3.Connection, entry: Entry) -> Entry:
    """An entry with its parameters; without them, and marked, if they or their documents are damaged."""
    number = entry.number
    damaged = checksums.damaged_parts(database, number, (ROW, PARAMETERS, *_WITH_DOF, _BUDGET))
    if damaged:
        return replace(entry, damaged=", ".join(damaged))
    try:
        row = checksums.columns(database, number, PARAMETERS)
        parameters = None if row is None else _parameters(*row)
        documents = _packed(database, number, (*_WITH_DOF, _BUDGET))
        combined = _BUDGET in documents
        if parameters is not None:
            parameters = of_noise(parameters, documents, combined=combined)
    except (*_UNREADABLE, sqlite3.DatabaseError):
        return replace(entry, damaged=PARAMETERS)
    return replace(entry, combined=combined, diagnosed=has_parts(documents), parameters=parameters)


def _packed(database: sqlite3.Connection, number: int, names: Sequence[str]) -> dict[str, str]:
    """Files of an entry by their names."""
    chosen = f"SELECT name, content FROM document WHERE number = ? AND name IN ({', '.join('?' * len(names))})"
    files = {}
    for name, content in database.execute(chosen, (number, *names)).fetchall():
        try:
            files[name] = zlib.decompress(content).decode("utf-8")
        except (zlib.error, TypeError, ValueError) as error:
            raise InputError(
                f"{name} of result {number} is damaged ({error}); restore the history from a copy"
            ) from error
    return files


def _parameters(names: str, values: bytes, covariance: bytes) -> "SensorParameters":
    import numpy as np

    from tumblecal.data.sensor_parameters import SensorParameters

    listed = tuple(json.loads(names))
    size = len(listed)
    return SensorParameters(listed, np.frombuffer(values, "<f8"), np.frombuffer(covariance, "<f8").reshape(size, -1))


@contextlib.contextmanager
def _open(path: Path, *, new: bool = False) -> Iterator[sqlite3.Connection]:
    """The open file, created if `new`; errors of SQLite become one line.

    **Raises:** `InputError`.
    """
    try:
        if new and not path.exists():
            _create(Path(os.path.realpath(path)))
        if path.is_dir():
            raise InputError(f"{path}: a folder; give a file, such as {path / 'lab.db'}")
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: a pipe or a device; give a file")
        if not path.is_file():
            raise InputError(f"{path}: no such history; create it by calibrate or diagnose with --history {path}")
        with contextlib.closing(sqlite3.connect(path, timeout=_PATIENCE_S, isolation_level=None)) as database:
            if database.execute("PRAGMA application_id").fetchone()[0] != _APPLICATION:
                raise InputError(f"{path}: a database, but not a history of tumblecal; give a different file")
            if (version := database.execute("PRAGMA user_version").fetchone()[0]) != _VERSION:
                raise InputError(
                    f"{path}: written by a different version of tumblecal (history {version}); use that version"
                )
            # Commits wait for the disk, so that entries remain after a power failure.
            database.execute("PRAGMA synchronous = FULL")
            # A damaged text is detected by its checksum, and is not a fault of the whole file.
            database.text_factory = lambda content: content.decode("utf-8", "replace")
            yield database
    except sqlite3.Error as error:
        raise InputError(f"{path}: {_reason(error)}") from error


def _create(path: Path) -> None:
    """Create the file completely under a temporary name, then rename it, unless another process was faster."""
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
            aside = Path(folder) / path.name
            with contextlib.closing(sqlite3.connect(aside, isolation_level=None)) as database:
                database.execute("PRAGMA journal_mode = WAL")
                database.executescript(_SCHEMA)
                database.execute(f"PRAGMA application_id = {_APPLICATION}")
                database.execute(f"PRAGMA user_version = {_VERSION}")
            try:
                os.link(aside, path)
            except FileExistsError:
                pass
            except OSError:  # a file system without hard links
                if not path.exists():
                    os.replace(aside, path)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be created ({reason(error)}); give a different file with --history"
        ) from error


def _reason(error: sqlite3.Error) -> str:
    text = str(error)
    if "locked" in text:
        return f"locked by another process for {_PATIENCE_S:g} s; try again"
    if "not a database" in text or "malformed" in text:
        return f"not a history ({text}); give a different file, or restore it from a copy"
    if "full" in text:
        return "not written, because the disk is full; free some space"
    if "I/O" in text:
        return f"cannot be written or read ({text}); check whether the disk is full or damaged"
    if "unable to open" in text or "readonly" in text or "read-only" in text:
        return f"cannot be written ({text}); give a different file"
    return text
