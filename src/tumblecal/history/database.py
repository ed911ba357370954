"""The file of a history: SQLite with a write-ahead log. An entry is one transaction, on disk before `add` returns.

Several processes can write at the same time (each waits for the others). If one is killed, the earlier entries are unchanged.
A part of an entry is its row, its parameters, or one of its documents. Each has its SHA-256 in the file, which is verified when
the part is read; the entries of a file without checksums get them when a result is added.
"""

import contextlib
import hashlib
import json
import math
import os
import re
import sqlite3
import tempfile
import zlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tumblecal.ground.errors import InputError
from tumblecal.ground.plain_text import plain
from tumblecal.ground.unwritable import reason
from tumblecal.history.entry import Entry


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
_CHECKSUMS = """CREATE TABLE checksum (
    number INTEGER NOT NULL, part TEXT NOT NULL, sha256 TEXT NOT NULL, PRIMARY KEY (number, part))"""
_ROW, _PARAMETERS = "its row", "its parameters"
_COLUMNS = "number, key, kind, serial, date_utc, source, sha256, outcome, rms_g, p_value"
_QUERIES = {
    _ROW: f"SELECT {_COLUMNS} FROM entry WHERE number = ?",
    _PARAMETERS: "SELECT names, estimate, covariance FROM parameters WHERE number = ?",
}
_DOCUMENT = "SELECT content FROM document WHERE number = ? AND name = ?"
# The parts that the parameters of an entry depend on: their documents have the degrees of freedom of the noise.
_CALIBRATION, _BUDGET = "calibration.json", "budget.json"
_OF_PARAMETERS = (_ROW, _PARAMETERS, _CALIBRATION, "result.json", _BUDGET)
_UNREADABLE = (ValueError, TypeError, KeyError, AttributeError, RecursionError, zlib.error)
# Errors of SQLite, in words.
_FAULTS = {
    "locked": f"locked by another process for {_PATIENCE_S:g} s; try again",
    "not a database|malformed": "not a history ({0}); give a different file, or restore it from a copy",
    "full": "not written, because the disk is full; free some space",
    "I/O": "cannot be written or read ({0}); check whether the disk is full or damaged",
    "unable to open|read-?only": "cannot be written ({0}); give a different file",
    "": "{0}",
}


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
    _, _, *columns = _COLUMNS.split(", ")
    with _open(path, new=True) as database:
        database.execute("BEGIN IMMEDIATE")
        with database:  # commits, or rolls back
            if not _has_checksums(database):
                database.execute(_CHECKSUMS)
                for number in _numbers(database):
                    _state(database, number)
            # The identity of an entry: its documents, or its date if it has none.
            content = [entry.kind, entry.serial, entry.source, entry.sha256, *sorted(entry.documents.items())]
            content += [] if entry.documents else [entry.date_utc]
            key = hashlib.sha256(json.dumps(content).encode()).hexdigest()
            row, marks = (key, *(getattr(entry, name) for name in columns)), ", ?" * (len(columns) + 1)
            added = database.execute(f"INSERT OR IGNORE INTO entry ({_COLUMNS}) VALUES (NULL{marks})", row)
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
            _state(database, number)
        return True


def listed(path: Path, serial: str | None = None) -> list[Entry]:
    """All entries, or those of a unit, in order of date, without parameters and documents.

    An entry with a damaged row is marked (`damaged`), and belongs to no unit.
    """
    with _open(path) as database:
        return _listed(database, serial)


def of_unit(path: Path, serial: str) -> list[Entry]:
    """The entries of a unit with their parameters, in order of date; an entry with a damaged part is marked and has none."""
    with _open(path) as database:
        return [_complete(database, entry, _OF_PARAMETERS) for entry in _listed(database, serial)]


def documents(path: Path, number: int) -> tuple[dict[str, str], list[str]]:
    """The files of an entry, except damaged ones, and the names of these."""
    with _open(path) as database:
        parts, damaged = _parts(database, number) if number in _numbers(database) else ({}, [])
        return _documents(parts, damaged), [part for part in damaged if part not in _QUERIES]


def checked(path: Path) -> tuple[list[Entry], list[str]]:
    """All entries with their damaged parts (`damaged`), and the faults of the file that SQLite finds.

    **Raises:** `InputError` if the file cannot be opened as a history.
    """
    with _open(path) as database:
        entries = {entry.number: entry for entry in _listed(database)}
        try:
            found = [str(words) for (words,) in database.execute("PRAGMA integrity_check").fetchall()]
        except sqlite3.DatabaseError as error:
            found = [str(error)]
        for number in _numbers(database):
            entry = entries.get(number) or Entry("", "", "", "", "", "", number=number, damaged=_ROW)
            entries[number] = _complete(database, entry)
    return _by_date(entries.values()), [" ".join(words.split()) for words in found if words != "ok"]


def _by_date(entries: Collection[Entry]) -> list[Entry]:
    return sorted(entries, key=lambda entry: (entry.date_utc, entry.number))


def _has_checksums(database: sqlite3.Connection) -> bool:
    return bool(database.execute("SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = 'checksum'").fetchone())


def _numbers(database: sqlite3.Connection) -> list[int]:
    """Numbers of all entries, including those with remaining parts only."""
    tables = ["entry", "document", "parameters", *(["checksum"] if _has_checksums(database) else [])]
    return [number for (number,) in database.execute(" UNION ".join(f"SELECT number FROM {name}" for name in tables))]


def _checksum(part: str, values: Sequence[object]) -> str:
    """The SHA-256 of the columns of a part; with type, length and bytes of each."""
    digest = hashlib.sha256(part.encode())
    for value in values:
        content = value if isinstance(value, bytes) else repr(value).encode("utf-8", "surrogateescape")
        digest.update(f" {type(value).__name__} {len(content)} ".encode() + content)
    return digest.hexdigest()


def _state(database: sqlite3.Connection, number: int) -> None:
    """Write the checksums of an entry in the file, within the open transaction."""
    for part, values in _parts(database, number, verified=False)[0].items():
        database.execute("INSERT OR REPLACE INTO checksum VALUES (?, ?, ?)", (number, part, _checksum(part, values)))


def _parts(
    database: sqlite3.Connection, number: int, wanted: Collection[str] = (), *, verified: bool = True
) -> tuple[dict[str, tuple], list[str]]:
    """The columns of the parts of an entry, all or those `wanted`, and the names of the damaged or missing ones."""
    stated = dict[str, str]()
    if verified and _has_checksums(database):
        query = "SELECT part, sha256 FROM checksum WHERE number = ?"
        stated = dict(database.execute(query, (number,)).fetchall())
    names = [name for (name,) in database.execute("SELECT name FROM document WHERE number = ?", (number,)).fetchall()]
    parts, damaged = dict[str, tuple](), list[str]()
    for part in dict.fromkeys((*_QUERIES, *names, *stated)):
        if wanted and part not in wanted:
            continue
        query = (_QUERIES[part], (number,)) if part in _QUERIES else (_DOCUMENT, (number, part))
        try:
            values = database.execute(*query).fetchone()
        except sqlite3.DatabaseError:  # its page is damaged
            values, stated[part] = None, ""
        if part in stated and (values is None or _checksum(part, values) != stated[part]):
            damaged.append(part)
        elif values is not None:
            parts[part] = values
    return parts, damaged


def _documents(parts: dict[str, tuple], damaged: list[str]) -> dict[str, str]:
    """The texts of documents; `damaged` gets those that cannot be read."""
    texts = dict[str, str]()
    for name in parts.keys() - _QUERIES.keys():
        try:
            texts[name] = zlib.decompress(parts[name][0]).decode("utf-8")
        except _UNREADABLE:
            damaged.append(name)
    return texts


def _listed(database: sqlite3.Connection, serial: str | None = None) -> list[Entry]:
    """The entries by their rows; if a page of the file is damaged, those that can be read separately."""
    stated, checksums = dict[int, str](), "SELECT number, sha256 FROM checksum WHERE part = ?"
    if _has_checksums(database):
        with contextlib.suppress(sqlite3.DatabaseError):
            stated = dict(database.execute(checksums, (_ROW,)).fetchall())
    try:
        rows = database.execute(f"SELECT {_COLUMNS} FROM entry").fetchall()
    except sqlite3.DatabaseError:
        rows = list[Sequence]()
        for number in _numbers(database):
            with contextlib.suppress(sqlite3.DatabaseError):
                rows += database.execute(_QUERIES[_ROW], (number,)).fetchall()
        if not rows:
            raise
    entries = [_entry(row, stated.get(row[0])) for row in rows]
    return _by_date([e for e in entries if serial is None or (e.serial == serial and not e.damaged)])


def _entry(row: Sequence, stated: str | None) -> Entry:
    """The entry of a row with its stated checksum, if any; if damaged, it is marked, and keeps a valid date."""
    texts, sizes = row[2:8], row[8:]
    good = all(isinstance(text, str) for text in texts)
    good &= all(size is None or (isinstance(size, float | int) and math.isfinite(size)) for size in sizes)
    good &= stated is None or _checksum(_ROW, row) == stated
    kind, serial, date_utc, source, sha256, outcome = [plain(str(text)) for text in texts]
    rms_g, p_value = sizes if good else (None, None)
    entry = Entry(
        kind, serial, date_utc, source, sha256, outcome, rms_g, p_value, number=row[0], damaged="" if good else _ROW
    )
    if (stated is None or not good) and not entry.dated:
        return replace(entry, damaged=_ROW, date_utc="")
    return entry


def _complete(database: sqlite3.Connection, entry: Entry, wanted: Collection[str] = ()) -> Entry:
    """An entry with its parameters; without them, and marked, if one of the parts `wanted` (default: all) is damaged."""
    parts, damaged = _parts(database, entry.number, wanted)
    texts = _documents(parts, damaged)
    damaged = [*dict.fromkeys([*filter(None, [entry.damaged]), *damaged])]
    if damaged:
        return replace(entry, damaged=", ".join(damaged))
    try:
        calibration: Any = json.loads(texts.get(_CALIBRATION, "{}"))
    except (ValueError, RecursionError):  # files from other sources have no information on the noise
        calibration = {}
    provenance = calibration.get("provenance") if isinstance(calibration, dict) else None
    provenance = provenance if isinstance(provenance, dict) else {}
    parameters, combined = None, _BUDGET in texts
    if _PARAMETERS in parts:
        try:
            noise = calibration.get("parameters") if combined else None
            parameters = _parameters(parts[_PARAMETERS], provenance.get("dof"), noise)
        except _UNREADABLE:
            return replace(entry, damaged=_PARAMETERS)
    return replace(entry, combined=combined, diagnosed="uncertainty_parts" in provenance, parameters=parameters)


def _parameters(columns: Sequence, dof: Any, noise: Any) -> "SensorParameters":
    """The parameters of an entry; without stated degrees of freedom of the noise their covariance is treated as known.

    **Arguments:**

    - `columns`: their names, values and covariance in the file.
    - `noise`: the parameters with the covariance of the noise alone, as in a calibration file, if that of the entry includes
      the inputs of a budget.
    """
    import numpy as np

    from tumblecal.data.sensor_parameters import SensorParameters

    names, values, covariance = columns
    listed = tuple(json.loads(names))
    square = np.frombuffer(covariance, "<f8").reshape(len(listed), -1)
    parameters = SensorParameters(listed, np.frombuffer(values, "<f8"), square)
    if not isinstance(dof, int | float) or not math.isfinite(dof):
        return parameters
    of_noise = isinstance(noise, dict) and noise.get("names") == list(listed)
    return replace(parameters, dof=float(dof), noise=np.array(noise["covariance"]) if of_noise else None)


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
        words = next(words for pattern, words in _FAULTS.items() if re.search(pattern, str(error)))
        raise InputError(f"{path}: {words.format(error)}") from error


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
