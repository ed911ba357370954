"""Files written where something stands already: links, pipes, what a process has open, what is read-only."""

import os
import stat

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
