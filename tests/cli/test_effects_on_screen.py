"""`tumblecal effects` in a narrow terminal and in a pipe: ids and texts are whole."""

import re

from tumblecal.effects import catalogue


def test_ids_and_words_are_whole_in_a_narrow_terminal(tumblecal, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TTY_COMPATIBLE", "1")  # a terminal
    lines = re.sub(r"\x1b\[[0-9;]*m", "", tumblecal("effects").out).splitlines()
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
