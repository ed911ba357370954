"""Files written where something stands already: links, pipes, what a process has open, what is read-only."""

import os
import stat
from pathlib import Path

import pytest

from tumblecal import InputError
from tumblecal.ground.atomic import writable_file, write_text, written_aside


def by_aside(path, text):
    with written_aside(path) as aside:
        aside.write_text(text)


WRITERS = pytest.mark.parametrize("write", [write_text, by_aside])


@WRITERS
@pytest.mark.parametrize("there", [True, False])
def test_of_a_link_the_file_is_written_that_it_names(tmp_path, write, there):
    target, link = tmp_path / "elsewhere" / "target", tmp_path / "link.json"
    target.parent.mkdir()
    (tmp_path / "further").symlink_to("elsewhere/target")
    link.symlink_to("further")
    if there:
        target.write_text("old")
    write(link, "new")
    assert link.is_symlink() and not target.is_symlink() and target.read_text() == "new"
    assert [path.name for path in target.parent.iterdir()] == ["target"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["elsewhere", "further", "link.json"]


@WRITERS
def test_a_pipe_gets_the_bytes_and_stays(tmp_path, write):
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    descriptor = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write(pipe, "whole")
        assert os.read(descriptor, 100) == b"whole"
    finally:
        os.close(descriptor)
    assert stat.S_ISFIFO(pipe.stat().st_mode) and list(tmp_path.iterdir()) == [pipe]


@WRITERS
def test_what_a_process_has_open_is_written_through(tmp_path, write):
    """As /dev/stdout is: a pipe, or a file that others go on writing to."""
    for mode in ("pipe", "file"):
        reading, writing = os.pipe() if mode == "pipe" else (None, os.open(tmp_path / "log", os.O_RDWR | os.O_CREAT))
        os.write(writing, b"before\n")
        writable_file(Path(f"/dev/fd/{writing}"))
        write(Path(f"/dev/fd/{writing}"), "whole")
        got = os.read(reading, 100) if reading is not None else (tmp_path / "log").read_bytes()
        assert got == b"before\nwhole"
        os.close(writing)


@WRITERS
def test_a_read_only_file_is_left_as_it_is_and_another_keeps_its_rights(tmp_path, write):
    path = tmp_path / "a.json"
    path.write_text("old")
    path.chmod(0o444)
    for refused in (lambda: write(path, "new"), lambda: writable_file(path)):
        with pytest.raises(InputError, match=r"a\.json: is read-only, and was not changed; give a different file"):
            refused()
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]
    path.chmod(0o640)
    write(path, "new")
    assert path.read_text() == "new" and stat.S_IMODE(path.stat().st_mode) == 0o640


def test_links_that_go_round_and_disks_are_refused(tmp_path, monkeypatch):
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(InputError, match=r"a: cannot be written .*symbolic links"):
        write_text(tmp_path / "a", "new")
    monkeypatch.setattr(stat, "S_ISBLK", lambda mode: True)
    with pytest.raises(InputError, match=": is a disk"):
        write_text(tmp_path, "new")
