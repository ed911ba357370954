"""The history's file: SQLite with a write-ahead log. An entry is one transaction, on the disk before `add` returns.

Several processes may write at once (each waits for the other); one that is killed leaves the entries that were there.
"""

import contextlib
import hashlib
import json
import os
import sqlite3
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.ground.atomic import reason
from tumblecal.ground.errors import InputError
from tumblecal.history.entry import Entry
from tumblecal.history.noise_of_entry import of_noise


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
_TELLING = ("calibration.json", "result.json")  # where the degrees of freedom of the noise stand
_COLUMNS = "kind, serial, date_utc, source, sha256, outcome, rms_g, p_value"
_ENTRY = f"INSERT OR IGNORE INTO entry (key, {_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"


def ready(path: Path) -> None:
    """Make the file where it is missing, and check that it is a history.

    **Raises:** `InputError` where it is none, or cannot be made.
    """
    with _open(path, new=True):
        pass


def add(path: Path, entry: Entry) -> bool:
    """Add an entry; the same one is not added twice.

    **Returns:** whether it is new.

    **Raises:** `InputError` where the file cannot be written, or is another kind of file.
    """
    own = (
        entry.kind,
        entry.serial,
        entry.date_utc,
        entry.source,
        entry.sha256,
        entry.outcome,
        entry.rms_g,
        entry.p_value,
    )
    with _open(path, new=True) as database:
        database.execute("BEGIN IMMEDIATE")
        with database:  # commits, or takes all of it back
            added = database.execute(_ENTRY, (_key(entry), *own))
            if not added.rowcount:
                return False
            number, parameters = added.lastrowid, entry.parameters
            if parameters is not None:
                arrays = (parameters.values.astype("<f8").tobytes(), parameters.covariance.astype("<f8").tobytes())
                row = (number, json.dumps(parameters.names), *arrays)
                database.execute("INSERT INTO parameters VALUES (?, ?, ?, ?)", row)
            for name, text in entry.documents.items():
                packed = zlib.compress(text.encode("utf-8", "replace"))
                database.execute("INSERT INTO document VALUES (?, ?, ?)", (number, name, packed))
        return True


def listed(path: Path, serial: str | None = None) -> list[Entry]:
    """All entries, or those of a unit, in order of their dates: without parameters and documents."""
    chosen, values = ("WHERE serial = ?", (serial,)) if serial is not None else ("", ())
    with _open(path) as database:
        rows = database.execute(f"SELECT {_COLUMNS}, number FROM entry {chosen} ORDER BY date_utc, number", values)
        return [Entry(*row[:8], number=row[8]) for row in rows]


def of_unit(path: Path, serial: str) -> list[Entry]:
    """A unit's entries with their parameters, in order of their dates."""
    budgeted = "EXISTS (SELECT 1 FROM document WHERE document.number = entry.number AND name = 'budget.json')"
    query = f"SELECT {_COLUMNS}, number, {budgeted}, names, estimate, covariance"
    query += " FROM entry LEFT JOIN parameters USING (number)"
    with _open(path) as database:
        rows = database.execute(f"{query} WHERE serial = ? ORDER BY date_utc, number", (serial,)).fetchall()
        entries = []
        for row in rows:
            parameters = _parameters(*row[10:])
            if parameters is not None:
                parameters = of_noise(parameters, _packed(database, row[8], _TELLING), combined=bool(row[9]))
            entries.append(Entry(*row[:8], number=row[8], combined=bool(row[9]), parameters=parameters))
    return entries


def documents(path: Path, number: int) -> dict[str, str]:
    """The files of an entry, as they were written."""
    with _open(path) as database:
        return _packed(database, number)


def _packed(database: sqlite3.Connection, number: int, names: tuple[str, ...] = ()) -> dict[str, str]:
    """The files of an entry, or those of some names."""
    chosen = f" AND name IN ({', '.join('?' * len(names))})" if names else ""
    rows = database.execute(f"SELECT name, content FROM document WHERE number = ?{chosen}", (number, *names))
    return {name: zlib.decompress(content).decode("utf-8") for name, content in rows}


def _parameters(names: str | None, values: bytes, covariance: bytes) -> "SensorParameters | None":
    if names is None:
        return None
    import numpy as np

    from tumblecal.data.sensor_parameters import SensorParameters

    own = tuple(json.loads(names))
    return SensorParameters(own, np.frombuffer(values, "<f8"), np.frombuffer(covariance, "<f8").reshape(len(own), -1))


def _key(entry: Entry) -> str:
    """What tells an entry from others: its documents, or what stands for them."""
    content = [entry.kind, entry.serial, entry.source, entry.sha256, *sorted(entry.documents.items())]
    if not entry.documents:
        content.append(entry.date_utc)
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


@contextlib.contextmanager
def _open(path: Path, *, new: bool = False) -> Iterator[sqlite3.Connection]:
    """The file, made where `new` allows it; what SQLite refuses becomes one line.

    **Raises:** `InputError`.
    """
    try:
        if new and not path.exists():
            _create(Path(os.path.realpath(path)))
        if path.is_dir():
            raise InputError(f"{path}: a folder; a history is a file, such as {path / 'lab.db'}")
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: a pipe or a device; a history is a file: give another name")
        if not path.is_file():
            raise InputError(f"{path}: no such history; calibrate and diagnose write one with --history {path}")
        with contextlib.closing(sqlite3.connect(path, timeout=_PATIENCE_S, isolation_level=None)) as database:
            if database.execute("PRAGMA application_id").fetchone()[0] != _APPLICATION:
                raise InputError(f"{path}: a database, but no history of tumblecal; give another file")
            if (version := database.execute("PRAGMA user_version").fetchone()[0]) != _VERSION:
                raise InputError(f"{path}: written by another version of tumblecal (history {version}); use that one")
            # Commits wait for the disk: what was added is there after a power cut as well.
            database.execute("PRAGMA synchronous = FULL")
            yield database
    except sqlite3.Error as error:
        raise InputError(f"{path}: {_reason(error)}") from error


def _create(path: Path) -> None:
    """Make the file aside, whole, and give it its name, unless another process was first: SQLite cannot have two at it."""
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
            except OSError:  # a file system without links
                if not path.exists():
                    os.replace(aside, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be made ({reason(error)}); give another file with --history") from error


def _reason(error: sqlite3.Error) -> str:
    text = str(error)
    if "locked" in text:
        return f"another process has been writing for {_PATIENCE_S:g} s; try again"
    if "not a database" in text or "malformed" in text:
        return f"not a history ({text}); give another file, or restore it from a copy"
    if "full" in text:
        return "not written, the disk is full; make room"
    if "I/O" in text:
        return f"cannot be written or read ({text}); the disk is full or failing"
    if "unable to open" in text or "readonly" in text or "read-only" in text:
        return f"cannot be written ({text}); give another file"
    return text
