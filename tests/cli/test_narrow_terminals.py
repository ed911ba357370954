"""Terminals of 60 to 80 columns: names are whole, no word is broken, nothing is cut off."""

import pytest

from tumblecal.cli.command import Command


pytestmark = pytest.mark.usefixtures("few_effects")


@pytest.mark.parametrize("width", [60, 70, 80])
def test_diagnose_s_words_are_whole(capsys, monkeypatch, width):
    """Every paragraph of a diagnosis is said by `Command.say`."""
    said = (
        "Best explanation: bias_temperature.x + cross_axis_square.z_yy + outlier_position:a-position-named-at-length (p "
        f"0.97).\n- {'cross_axis_square.z_yy' * 4} = 0.2 mg/g^2 of SN-2558184602-0000-A7-REV-B-2026 in bench/first-unit.csv"
    )
    monkeypatch.setenv("COLUMNS", str(width))
    Command().say(said)
    check(capsys.readouterr().out, said, width)


def check(out: str, whole: str, width: int) -> None:
    lines = out.splitlines()
    assert not any("…" in line for line in lines)
    assert words(out) == words(whole)  # none is broken, none is missing
    # Only a word that is longer than the terminal stands out.
    assert all(len(line) <= width or len(line.split()) == 1 for line in lines), max(lines, key=len)


def words(text: str) -> set[str]:
    """The words of a text; headings of a narrow column end in a colon, and rules are as wide as the terminal."""
    return {word.rstrip(":") for word in text.split() if word.strip("-")}
