"""`tumblecal effects` in terminals of several widths and in a pipe: ids and texts are whole."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios

from tumblecal.effects import catalogue


def on_screen(columns: int) -> list[str]:
    """The lines that a real terminal of that width receives."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    command = [sys.executable, "-m", "tumblecal.cli", "effects"]
    process = subprocess.Popen(command, stdout=theirs, stdin=theirs, env=environment | {"TERM": "xterm"})
    os.close(theirs)
    received = b""
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        received += part
    os.close(ours)
    assert process.wait(timeout=600) == 0
    return re.sub(r"\x1b\[[0-9;]*m", "", received.decode()).splitlines()


def test_ids_and_words_are_whole_in_a_narrow_terminal():
    lines = on_screen(80)
    assert [line.split()[0] for line in lines[1:] if line[:1].strip()] == list(catalogue())
    assert max(map(len, lines)) <= 80 and not any("…" in line for line in lines)
    # The folded words are all there.
    start = lines[0].index("physics")
    for one in catalogue().values():
        first = next(k for k, line in enumerate(lines) if line.startswith(f"{one.id} "))
        rest = [line[start:].strip() for line in lines[first : first + 8]]
        assert " ".join(rest).startswith(one.physics)


def test_a_pipe_gets_every_entry_on_one_line(tumblecal):
    lines = tumblecal("effects").out.splitlines()
    entries = catalogue()
    assert len(lines) == len(entries) + 1
    for line, one in zip(lines[1:], entries.values(), strict=True):
        assert line.split()[0] == one.id and one.physics in line and one.unit in line
        assert all(name in line for name in one.needs)
    (advice,) = [line for line in tumblecal("effects", "gravity_value").out.splitlines() if "what to do" in line]
    assert entries["gravity_value"].advice in advice
