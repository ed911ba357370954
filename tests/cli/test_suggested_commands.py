"""Commands that texts suggest: what the user stated is stated again, and each runs as pasted."""

import re
import shlex
import sys
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from tumblecal.cli.commands import app
from tumblecal.cli.read_model import read_model
from tumblecal.data import write_positions
from tumblecal.data.positions import joined_arguments
from tumblecal.ground.suggested_command import EVERY, SHARED, suggested


pytestmark = pytest.mark.usefixtures("few_effects")


STATED = {
    "--rig": "my rig.toml",
    "--noise-sd": "0.1 mg",
    "--prior": "dbeta=3 arcmin",
    "--fix": "dtheta",
    "--head": "head.toml",
    "--gravity": "lat=48.14,height=520",
    "--columns": "position=pos no,alpha_deg=alpha,ax_g=AccX,n=count,ax_sd_g=sx",
    "--effects": "mine.py",
    "--attitudes": "hand",
    "--allow-alpha": "0:90:15",
    "--allow-beta": "-30:0:15",
    "--allow-mount": "none",
    "--unit": "16384/g",
    "--gyro-unit": "dps",
    "--time-unit": "ms",
    "--scale": "-1",
    "--offset": "3",
    "--rate": "100",
    "--topic": "imu0",
    "--protocol": "text",
    "--rows": "sensor=1",
    "--signed": "16",
    "--decimal": "comma",
    "--range-g": "4",
    "--run": "second run",
    "--mount": "B",
    "--port": "/dev/ttyUSB0",
    "--wait": "9",
    "--plan": "plan.toml",
    "--table": "files of the run.csv",
    "--by": "part",
    "--u-gravity": "1e-6",
    "--repeatability": "bias=0.3 mg",
}


def words(text: str) -> list[str]:
    """The command that ends a text, without the program's name."""
    (command,) = re.findall(r"(?:^|: )tumblecal (\S.*)$", text, re.M)
    return shlex.split(command)


def parsed(command: list[str]) -> dict:
    _, bound, ignored = app.parse_args(command, print_error=False, exit_on_error=False)
    assert not ignored
    return bound.arguments


@pytest.fixture
def invoked(monkeypatch):
    def invoke(*arguments: str) -> None:
        monkeypatch.setattr(sys, "argv", ["/usr/bin/tumblecal", *arguments])

    return invoke


@pytest.mark.parametrize("command", SHARED)
def test_what_was_stated_is_stated_again(invoked, command):
    """Every second option is written with `=`."""
    options = [
        [f"{name}={value}"] if number % 2 or value[0] == "-" else [name, value]
        for number, (name, value) in enumerate(STATED.items())
    ]
    invoked("calibrate", "a.csv", "--out", "o", *chain(*options), "--prior", "bias=1 mg")
    two = command in ("apply", "check")
    file = "cal.json" if two else "my file.csv"
    line = suggested(command, *([] if command == "capture" else [Path(file)]), *(["x"] if two else []))
    assert shlex.split(line)[:2] == ["tumblecal", command] and "--out" not in line
    given = shlex.split(line)
    for option in SHARED[command]:
        value = STATED[option]
        if option == "--columns" and command in ("reduce", "import", "apply", "check"):
            value = "position=pos no,alpha_deg=alpha,ax_g=AccX"
        assert f"{option}={value}" in given or given[given.index(option) + 1] == value
    assert given.count("--prior") == (2 if "--prior" in SHARED[command] else 0)
    parsed(given[1:])
    assert shlex.split(suggested(command, Path("-a.csv"), less=EVERY)) == ["tumblecal", command, "./-a.csv"]


def test_a_suggested_diagnosis_reads_the_user_s_own_columns(tumblecal, tmp_path, monkeypatch, table1):
    """With a file's own column names, semicolons and blanks in names; and the same joined with the program's own file."""
    monkeypatch.chdir(tmp_path)
    names = ("pos no", "alpha", "beta", "AccX", "AccY", "AccZ")
    columns = zip(("position", "alpha_deg", "beta_deg", "ax_g", "ay_g", "az_g"), names, strict=True)
    rows = zip(table1.names, table1.alpha_deg, table1.beta_deg, *table1.readings.T, strict=True)
    lines = [";".join(map(str, row)).replace(".", ",") for row in [names, *rows]]
    Path("my data.csv").write_text("\n".join(lines) + "\n")
    named = ",".join(f"{name}={own}" for name, own in columns)
    options = ["--columns", named, "--gravity", "9.8123", "--noise-sd", "0.01 mg"]
    outcome = tumblecal("calibrate", "my data.csv", *options, "-q")
    (said,) = [line for line in outcome.lines if "Run: tumblecal" in line]
    assert words(said)[:2] == ["diagnose", "my data.csv"] and parsed(words(said))["model"].gravity == "9.8123"
    # The positions proposed next are in a file of the program's own, joined with the user's.
    line = suggested("diagnose", *joined_arguments(["my data.csv", "next/positions.csv"]))
    assert parsed(words(line))["joining"].join
    write_positions(Path("positions.csv"), table1)
    model = read_model(parsed(words(line))["model"])
    own, new = (model.read(Path(name), one_of_several=True) for name in ("my data.csv", "positions.csv"))
    np.testing.assert_array_equal(own.readings, new.readings)
    assert own.names == new.names
