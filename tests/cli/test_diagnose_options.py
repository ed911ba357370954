"""`tumblecal diagnose`: what may be measured next, what is held out, several files as one."""

import json
import shlex

import pytest

from tumblecal import read_rig, simulate
from tumblecal.capture.capture_plan import read_plan
from tumblecal.cli.commands import app
from tumblecal.data import write_positions


pytestmark = pytest.mark.usefixtures("few_effects")


def test_next_positions_stay_on_the_allowed_angles(tumblecal, tmp_path, table1_file):
    """One of the two given as a range, the other by commas; the lab cannot turn the triad."""
    options = ["--allow-alpha", "0:360:90", "--allow-beta", "0,20", "--allow-beta", "70", "--allow-mount", "none"]
    outcome = tumblecal("diagnose", table1_file, "--out", tmp_path / "out", "--no-figures", *options)
    assert outcome.code == 0 and "next_positions.toml" in outcome.out.splitlines()[-1]
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    listed = [*found["next_positions"], *found["next_plan"]["together"]]
    assert listed and found["next_plan"]["value"] > 0.05
    for one in listed:
        assert one["alpha_deg"] in (0, 90, 180, 270) and one["beta_deg"] in (0, 20, 70) and one["mount"] == ""
    text = (tmp_path / "out" / "next_positions.toml").read_text()
    capture, reduce, join = (shlex.split(line[2:]) for line in text.splitlines() if line.startswith("# tumblecal "))
    assert capture[1:3] == ["capture", str(tmp_path / "out" / "next_positions.toml")] and reduce[1:] == [
        "reduce",
        "next",
    ]
    assert join[1:6] == ["diagnose", "--join", "--same-run", str(table1_file), "next/positions.csv"]
    _, bound, _ = app.parse_args(join[1:], print_error=False, exit_on_error=False)
    assert bound.arguments["following"].allow_alpha == ("0:360:90",)
    plan = read_plan(tmp_path / "out" / "next_positions.toml")
    assert len(plan.steps) == len(found["next_plan"]["together"])
    assert sorted(path.name for path in (tmp_path / "out").glob("next_*")) == ["next_positions.toml"]


@pytest.mark.long
def test_two_mountings_joined_and_one_held_out(tumblecal, tmp_path, configs):
    """The two mountings of configs/remount.toml in two files: together they are the whole; mounting B is predicted."""
    whole, rig = tmp_path / "whole.csv", configs / "remount.toml"
    assert tumblecal("simulate", rig, "--out", whole, "--seed", 4).code == 0
    lines = [line for line in whole.read_text().splitlines() if not line.startswith("#")]
    for name in "AB":
        rows = [line for line in lines[1:] if f",{name}" in line]
        (tmp_path / f"{name}.csv").write_text("\n".join([lines[0], *rows, ""]))
    options = ["--rig", rig, "--no-figures", "--holdout"]
    joined = ["--join", tmp_path / "A.csv", tmp_path / "B.csv"]
    assert tumblecal("diagnose", *joined, *options, "mount=B", "--out", tmp_path / "joined").code == 0
    assert tumblecal("diagnose", whole, *options, "mount=B", "--out", tmp_path / "whole").code == 0
    one, other = (json.loads((tmp_path / name / "diagnosis.json").read_text()) for name in ("joined", "whole"))
    assert one["gain"]["cv_kind"] == other["gain"]["cv_kind"] == "mount B left out"
    assert one["gain"] == other["gain"] and one["verdict"] == other["verdict"] == "adequate"
    for held_out, words in (("mount=C", "has mount A, B; name one of several"), ("colour=red", "has no column colour")):
        outcome = tumblecal("diagnose", whole, *options, held_out, "--out", tmp_path / "none")
        assert outcome.code == 2 and words in outcome.lines[0] and not (tmp_path / "none").exists()


@pytest.fixture(scope="module")
def two_files(tmp_path_factory, configs):
    """A head whose pitch settings come back by a milliradian: the paper's plan twice."""
    folder, rig = tmp_path_factory.mktemp("joined"), (configs / "paper24.toml").read_text()
    (folder / "again.toml").write_text(rig.replace("[1.5, -1.8, -2.1]", "[2.5, -2.8, -1.1]"))
    files = []
    for name, seed, lab in (("a", 5, configs / "paper24.toml"), ("b", 6, folder / "again.toml")):
        files.append(folder / f"{name}.csv")
        write_positions(files[-1], simulate(read_rig(lab), seed))
    return files


@pytest.mark.long
def test_joined_files_are_runs_of_their_own(tumblecal, tmp_path, two_files):
    """Two files are adequate as two runs, not as one."""
    options = ["--noise-sd", "0.15mg", "--no-figures", "--out", tmp_path / "out"]
    outcome = tumblecal("diagnose", "--join", *two_files, *options)
    assert outcome.out.startswith("Runs: a, b. With --same-run, ")
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text())["verdict"] == "adequate"
    outcome = tumblecal("diagnose", "--join", "--same-run", *two_files, *options)
    assert outcome.out.startswith("Assumed: one run for all 2 files.\n")
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text())["verdict"] != "adequate"
