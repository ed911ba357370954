"""A disk that is full, or a history that is held, while something is added: nothing lost, nothing torn, a clear line."""

import json
import sqlite3
from dataclasses import replace

import pytest
from test_history import results

from disk import file_size_limited
from tumblecal import InputError
from tumblecal.data import write_positions
from tumblecal.history import database
from tumblecal.history.database import add, documents, listed


LARGE = json.dumps([k / 7 for k in range(20_000)])  # more than a page, and little of it goes


def test_what_was_added_before_the_disk_was_full_is_whole_and_the_rest_is_added_later(tmp_path):
    path = tmp_path / "lab.db"
    entries = [replace(entry, documents={"result.json": f"{k}{LARGE}"}) for k, entry in enumerate(results(4))]
    for entry in entries[:2]:
        add(path, entry)
    refused = 0
    for room in range(2_000, 200_000, 15_000):
        with file_size_limited(room):
            try:
                added = add(path, entries[2])
            except InputError as error:
                refused += 1
                (line,) = error.faults
                assert line.startswith(f"{path}: ") and "the disk is full" in line
                added = False
        kept = listed(path)
        assert len(kept) == 2 + added and sqlite3.connect(path).execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert [documents(path, entry.number)[0]["result.json"][1:] == LARGE for entry in kept] == [True] * len(kept)
        if added:
            break
    assert refused >= 3 and added  # the write-ahead log took it: readers see it, though the file itself could not grow
    assert add(path, entries[3]) and len(listed(path)) == 4


def test_a_history_that_cannot_be_made_leaves_nothing(tmp_path):
    with file_size_limited(5_000), pytest.raises(InputError, match="the disk is full"):
        add(tmp_path / "lab.db", results(1)[0])
    assert not list(tmp_path.iterdir())


def test_results_that_cannot_be_added_are_there_and_the_line_says_how_to_add_them(
    tumblecal, tmp_path, monkeypatch, table1
):
    path, data = tmp_path / "lab.db", tmp_path / "data.csv"
    write_positions(data, replace(table1, comments={"serial_number": "A-17"}))
    database.ready(path)
    monkeypatch.setattr(database, "_PATIENCE_S", 0.05)
    holding = sqlite3.connect(path, isolation_level=None)
    holding.execute("BEGIN IMMEDIATE")
    outcome = tumblecal("calibrate", data, "--no-figures", "--history", path, "--out", tmp_path / "c")
    holding.close()
    assert outcome.code == 2 and len(outcome.lines) == 1 and "locked by another process" in outcome.lines[0]
    assert (tmp_path / "c" / "calibration.json").is_file() and not listed(path)
    said = outcome.lines[0].rpartition("later: tumblecal ")[2].split()
    assert tumblecal(*said).code == 0 and [entry.serial for entry in listed(path)] == ["A-17"]
