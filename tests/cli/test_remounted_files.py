"""Remounted triads without a rig: `diagnose`, `diagnose --join` and `calibrate` find the turn and say it."""

import json

import pytest

from tumblecal.capture.capture_plan import read_plan


pytestmark = pytest.mark.usefixtures("few_effects")


@pytest.fixture(scope="module")
def remounted(tmp_path_factory, configs):
    """Positions of configs/remount.toml, the second mounting turned 90 deg about z: one file, and one for each."""
    from tumblecal.cli.simulate import simulate

    folder = tmp_path_factory.mktemp("remounted")
    simulate(configs / "remount.toml", out=folder / "whole.csv", seed=4)
    lines = [line for line in (folder / "whole.csv").read_text().splitlines() if not line.startswith("#")]
    place = lines[0].split(",").index("mount")
    for name in "AB":
        rows = [line.split(",") for line in lines[1:] if line.split(",")[place] == name]
        cells = [lines[0].split(","), *rows]
        text = "\n".join(",".join(cell for k, cell in enumerate(row) if k != place) for row in cells)
        (folder / f"{name}.csv").write_text(text + "\n")
    return folder


WORDS = "Assumed: the triad is turned 90 deg about z in mounting B; dtheta is relative to this."


@pytest.mark.long
def test_a_column_of_mounts_and_joined_files_without_one(tumblecal, tmp_path, remounted):
    options = ["--noise-sd", "0.15mg", "--no-figures", "--out", tmp_path / "out"]
    for files in ([remounted / "whole.csv"], ["--join", remounted / "A.csv", remounted / "B.csv"]):
        outcome = tumblecal("diagnose", *files, *options)
        assert outcome.code == 0 and outcome.out.startswith("ADEQUATE") and WORDS in " ".join(outcome.out.split())
        found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
        first = "A" if len(files) == 1 else "1"
        assert found["mountings"] == {first: {"rotation_deg": [0, 0, 0]}, "B": {"rotation_deg": [0, 0, 90]}}
        assert {f"dtheta_z@mount={first}", "dtheta_z@mount=B", "dbeta_2@mount=B"} <= set(found["shifts"])


@pytest.mark.long
def test_a_turn_in_next_positions(tumblecal, tmp_path, configs):
    """Turned about the spindle the x axis stays weak: another mounting is proposed, under a label that is still free."""
    text = (configs / "remount.toml").read_text().replace("[0, 0, 90]", "[90, 0, 0]")
    (tmp_path / "lab.toml").write_text(text.replace('"B"', '"turned_z"').replace("[mounts.B]", "[mounts.turned_z]"))
    assert tumblecal("simulate", tmp_path / "lab.toml", "--out", tmp_path / "lab.csv", "--seed", 1).code == 0
    options = ["--noise-sd", "0.15mg", "--no-figures", "--allow-beta", "0,45,90", "--out", tmp_path / "out"]
    outcome = tumblecal("diagnose", tmp_path / "lab.csv", *options)
    assert outcome.code == 0 and "turned 90 deg about x in mounting turned_z" in outcome.out
    new = {path.name: read_plan(path) for path in (tmp_path / "out").glob("next_positions_turned_*.toml")}
    turns = {plan.session.mount: tuple(plan.positions.mount_rotation_deg) for plan in new.values()}
    assert turns and turns.items() <= {"turned_z_2": (0, 0, 90), "turned_y": (0, 90, 0)}.items()
