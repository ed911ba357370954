"""SHA-256 of each part of an entry, written with the entry and verified when it is read.

A part is the row of the entry, its parameters, or one of its documents. The entries of a file without checksums get them when a
result is added.
"""

import hashlib
import sqlite3
from collections.abc import Iterable, Iterator, Sequence


_TABLE = """CREATE TABLE checksum (
    number INTEGER NOT NULL, part TEXT NOT NULL, sha256 TEXT NOT NULL, PRIMARY KEY (number, part))"""
ROW, PARAMETERS = "its row", "its parameters"
COLUMNS = "number, key, kind, serial, date_utc, source, sha256, outcome, rms_g, p_value"
_QUERIES = {
    ROW: f"SELECT {COLUMNS} FROM entry WHERE number = ?",
    PARAMETERS: "SELECT names, estimate, covariance FROM parameters WHERE number = ?",
}


def checksum(part: str, values: Sequence[object]) -> str:
    """The SHA-256 of the columns of a part; with type, length and bytes of each."""
    digest = hashlib.sha256(part.encode())
    for value in values:
        content = value if isinstance(value, bytes) else repr(value).encode("utf-8", "surrogateescape")
        digest.update(f" {type(value).__name__} {len(content)} ".encode() + content)
    return digest.hexdigest()


def has_checksums(database: sqlite3.Connection) -> bool:
    """Whether the file has checksums."""
    return bool(database.execute("SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = 'checksum'").fetchone())


def ready(database: sqlite3.Connection) -> None:
    """Create the table of checksums of all entries if it is missing, within the open transaction."""
    if not has_checksums(database):
        database.execute(_TABLE)
        for (number,) in database.execute("SELECT number FROM entry").fetchall():
            state(database, number)


def state(database: sqlite3.Connection, number: int) -> None:
    """Write the checksums of an entry in the file, within the open transaction."""
    for part in (*_QUERIES, *document_names(database, number)):
        if (values := columns(database, number, part)) is not None:
            row = (number, part, checksum(part, values))
            database.execute("INSERT OR REPLACE INTO checksum VALUES (?, ?, ?)", row)


def damaged_parts(database: sqlite3.Connection, number: int, parts: Iterable[str] = ()) -> list[str]:
    """The damaged or missing parts of an entry, among the given parts or among all."""
    if not has_checksums(database):
        return []
    query = "SELECT part, sha256 FROM checksum WHERE number = ?"
    stated, wanted = dict(database.execute(query, (number,)).fetchall()), set(parts)
    compared = [part for part in stated if not wanted or part in wanted]
    return [part for part in compared if not _unchanged(database, number, part, stated[part])]


def numbers(database: sqlite3.Connection) -> list[int]:
    """Numbers of all entries, including those with remaining parts only."""
    tables = ["entry", "document", "parameters", *(["checksum"] if has_checksums(database) else [])]
    return [number for (number,) in database.execute(" UNION ".join(f"SELECT number FROM {name}" for name in tables))]


def faults(database: sqlite3.Connection) -> Iterator[str]:
    """Faults of the structure of the file, found by SQLite."""
    try:
        for (words,) in database.execute("PRAGMA integrity_check").fetchall():
            if words != "ok":
                yield " ".join(str(words).split())
    except sqlite3.DatabaseError as error:
        yield str(error)


def _unchanged(database: sqlite3.Connection, number: int, part: str, stated: object) -> bool:
    try:
        values = columns(database, number, part)
    except sqlite3.DatabaseError:  # its page is damaged
        return False
    return values is not None and checksum(part, values) == stated


def columns(database: sqlite3.Connection, number: int, part: str) -> tuple | None:
    """The columns of a part of an entry; None if it does not exist."""
    if part in _QUERIES:
        return database.execute(_QUERIES[part], (number,)).fetchone()
    return database.execute("SELECT content FROM document WHERE number = ? AND name = ?", (number, part)).fetchone()


def document_names(database: sqlite3.Connection, number: int) -> list[str]:
    """The names of the files of an entry."""
    return [name for (name,) in database.execute("SELECT name FROM document WHERE number = ?", (number,)).fetchall()]
