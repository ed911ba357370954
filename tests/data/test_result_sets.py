"""A set of results is one unit: whenever a process is killed or interrupted, a folder has files of one set alone."""

import json
import os
import subprocess
import sys
from contextlib import contextmanager

import pytest

from tumblecal.ground.atomic import write_text
from tumblecal.ground.errors import InputError
from tumblecal.ground.result_set import result_set
from tumblecal.ground.text_file import read_text


NAMES = ("result.json", "page.html", "*.svg")
OLD = {"result.json": "old", "page.html": "old page", "only_old.svg": "old figure"}
NEW = {"result.json": "new", "page.html": "new page", "new.svg": "new figure"}
# One process that forks a child for every event of the system (files opened, renamed, removed) while a set is written: the
# child ends there without a word (as by kill -9), or is interrupted there.
EVENTS = """
import json, os, sys
from pathlib import Path
from tumblecal.ground.atomic import write_text
from tumblecal.ground.result_set import result_set
folder, how, old, new, names = Path(sys.argv[1]), sys.argv[2], *map(json.loads, sys.argv[3:6])
WATCHED = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.chmod", "shutil.rmtree", "os.scandir"}
seen, last = 0, -1

def hook(event, arguments):
    global seen
    if event in WATCHED and last >= 0:
        seen += 1
        if seen == last:
            if how == "killed":
                os._exit(9)
            raise KeyboardInterrupt

def write(place, texts):
    with result_set(place, names) as aside:
        for name, text in texts.items():
            write_text(aside / name, text)

os.fsync = lambda _: None  # what is on the disk after a power cut is not the question
sys.addaudithook(hook)
for number in range(1, 500):
    place = folder / str(number)
    write(place, old)
    child = os.fork()
    if child == 0:
        seen, last = 0, number
        try:
            write(place, new)
        except KeyboardInterrupt:
            os._exit(1)
        os._exit(0)
    if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0:
        break
print(number)
"""


def contents(folder):
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


def hidden(folder):
    return [path.name for path in folder.rglob(".*")]


def write(folder, texts):
    with result_set(folder, NAMES) as aside:
        for name, text in texts.items():
            write_text(aside / name, text)


def at_every_event(folder, how, old=OLD):
    """Folders in which the writing of NEW over an old set ended at one event after the other."""
    given = [str(folder), how, *map(json.dumps, (old, NEW, NAMES))]
    done = subprocess.run([sys.executable, "-c", EVENTS, *given], capture_output=True, text=True, check=True)
    count = int(done.stdout)
    assert count > 20
    return [folder / str(number) for number in range(1, count + 1)]


def test_a_kill_at_any_event_leaves_files_of_one_set_alone_and_the_next_set_is_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda _: None)
    told = 0
    for folder in at_every_event(tmp_path, "killed"):
        there = contents(folder)
        assert there.items() <= OLD.items() or there.items() <= NEW.items()
        try:
            read_text(folder / "result.json")
        except InputError as error:
            told += 1
            assert "was killed" in str(error) and "run its command again" in str(error)
        else:
            assert there in (OLD, NEW)
        (folder / "mine.svg.txt").write_text("the user's own")
        if int(folder.name) % 2:
            write(folder, {"result.json": "third"})
            assert contents(folder) == {"result.json": "third", "mine.svg.txt": "the user's own"}
        else:  # a command with other names, as a budget into the folder of a calibration
            with result_set(folder, ("budget.json",)) as aside:
                write_text(aside / "budget.json", "budget")
            there = contents(folder)
            assert there.pop("budget.json") == "budget" and there.pop("mine.svg.txt") and there in (OLD, NEW)
        assert not hidden(folder)
    assert told > 5


def test_an_interrupt_at_any_event_leaves_one_whole_set(tmp_path):
    for folder in at_every_event(tmp_path, "interrupted"):
        assert contents(folder) in (OLD, NEW) and not hidden(folder)


def test_links_rights_and_read_only_files_are_kept(tmp_path):
    folder, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    write(folder, OLD)
    elsewhere.mkdir()
    (folder / "page.html").rename(elsewhere / "page.html")
    (folder / "page.html").symlink_to(elsewhere / "page.html")
    (folder / "result.json").chmod(0o640)
    write(folder, NEW)
    assert (folder / "page.html").is_symlink() and (elsewhere / "page.html").read_text() == "new page"
    assert (folder / "result.json").stat().st_mode & 0o777 == 0o640 and contents(folder) == NEW
    (folder / "page.html").unlink()
    (folder / "new.svg").chmod(0o440)
    with pytest.raises(InputError, match=r"new\.svg: is read-only"):
        write(folder, OLD)
    assert contents(folder) == {name: text for name, text in NEW.items() if name != "page.html"} and not hidden(folder)


@contextmanager
def started(program, path, word):
    """A process of its own, once it has said a word; killed at the end."""
    with subprocess.Popen([sys.executable, "-c", program, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == f"{word}\n"
        yield process
        process.kill()


HOLDER = """
import sys, time
from pathlib import Path
from tumblecal.ground.folder_lock import held
with held(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_command_into_the_same_folder_is_told_at_once_and_a_dead_one_holds_nothing(
    tumblecal, tmp_path, table1_file
):
    out = tmp_path / "out"
    out.mkdir()
    with started(HOLDER, out, "held") as holder:
        outcome = tumblecal("calibrate", table1_file, "--no-figures", "--out", out)
    assert outcome.code == 2 and len(outcome.lines) == 1
    assert "is writing its results here" in outcome.lines[0] and "--out" in outcome.lines[0]
    if sys.platform == "linux":
        assert f"({holder.pid})" in outcome.lines[0]
    assert out.is_dir() and not list(out.iterdir())
    assert tumblecal("calibrate", table1_file, "--out", out).code == 0
    assert (out / "calibration.html").exists() and (out / "residuals.svg").exists()
    # The page and the figures of the first are no results of the second.
    assert tumblecal("calibrate", table1_file, "--no-figures", "--out", out).code == 0
    assert sorted(path.name for path in out.iterdir()) == ["calibration.json", "result.json"]


def test_what_a_killed_process_was_writing_aside_is_removed_and_what_a_living_one_writes_is_not(tmp_path):
    program = """
import os, sys, time
from pathlib import Path
from tumblecal.ground.atomic import written_aside
with written_aside(Path(sys.argv[1])) as aside:
    aside.write_text("half")
    print("half", flush=True)
    time.sleep(60)
"""
    with started(program, tmp_path / "living.csv", "half"):
        with started(program, tmp_path / "dead.csv", "half"):
            assert len(hidden(tmp_path)) == 2
        write_text(tmp_path / "other.csv", "whole")
        assert [name.split(".")[1] for name in hidden(tmp_path)] == ["living"]
