"""Terminals of 60 to 80 columns: names are whole, no word is broken, nothing is cut off."""

from dataclasses import replace

import pytest

from tumblecal.cli.command import Command
from tumblecal.data import write_positions


pytestmark = pytest.mark.usefixtures("few_effects")


@pytest.fixture(scope="module")
def long_names(tmp_path_factory):
    """Two mountings of long names and a long serial number, the second mounting another one: parameters have long names."""
    from tumblecal.chain.rig_file import read_rig
    from tumblecal.simulation.position_means import simulated

    folder = tmp_path_factory.mktemp("a_folder_whose_name_is_as_long_as_those_of_a_company_s_share")
    rig = folder / "rig.toml"
    rig.write_text(
        'schema = "tumblecal.rig/1"\n[plan]\nalpha_deg = { start = 0, step = 45, count = 8 }\nbeta_deg = [0, 45, 90]\n'
        'mounts = ["upper-fixture-left", "lower-fixture-right"]\n[chain.leaves.dbeta]\nby = "mount.pitch"\n'
        '[chain.leaves.dtheta]\nby = "mount"\n[noise]\nsd = "0.1 mg"\n'
    )
    data = simulated(read_rig(rig), 1)
    path = folder / "measured_at_the_second_head_of_the_laboratory.csv"
    comments = data.comments | {"serial_number": "SN-2558184602-0000-A7-REV-B-2026"}
    write_positions(path, replace(data, comments=comments))
    return path, rig


@pytest.mark.long
def test_calibrate_s_names_and_words_are_whole(tumblecal, long_names, tmp_path, monkeypatch):
    path, rig = long_names
    command = ("calibrate", path, "--rig", rig, "--no-figures", "--out", tmp_path)
    monkeypatch.setenv("COLUMNS", "100000")
    whole = tumblecal(*command)
    assert whole.code == 0 and "dbeta_2@mount=lower-fixture-right" in whole.out
    for width in (60, 70, 80):
        monkeypatch.setenv("COLUMNS", str(width))
        check(tumblecal(*command).out, whole.out, width)


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
