"""`tumblecal plan` on the commands of docs/plan.md: its files, the chain to a calibration; and input that is rejected."""

import json
import re
import shlex
import tomllib
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from tumblecal.capture.capture_plan import read_plan
from tumblecal.cli.model_options import ModelOptions
from tumblecal.cli.read_model import read_model
from tumblecal.effects.catalogue import catalogue
from tumblecal.effects.rig_with_effects import read_rig_with_effects
from tumblecal.estimation.exact import fit
from tumblecal.simulation.position_means import simulated


pytestmark = pytest.mark.usefixtures("few_effects")


PAGE = (Path(__file__).parents[2] / "docs" / "plan.md").read_text(encoding="utf-8")


@pytest.mark.long
def test_the_commands_of_the_page_and_the_uncertainties_of_their_calibration(tumblecal, tmp_path, monkeypatch):
    """plan.md: the commands, without the forecast."""
    monkeypatch.chdir(tmp_path)
    commands = [line for block in re.findall(r"^```sh\n(.*?)^```", PAGE, re.S | re.M) for line in block.splitlines()]
    example, design, simulate, calibrate = (shlex.split(line)[1:] for line in commands)
    folder = tmp_path / "plan"
    folder.mkdir()
    mine = folder / "plan_mine.toml"
    mine.write_text("# not of this command")
    assert tumblecal(*example).code == 0
    designed = tumblecal(*design, "--no-forecast")
    assert designed.code == 0, designed.lines
    assert re.search(r"^24 positions in 2 mountings, ", designed.out, re.MULTILINE)
    assert "</html>" in (folder / "plan.html").read_text() and mine.exists()
    record = json.loads((folder / "plan.json").read_text())
    assert record["schema"] == "tumblecal.plan/1" and len(record["positions"]) == 24

    captured = [read_plan(folder / name) for name in record["files"] if name != "rig.toml"]
    steps = [(step.name, step.alpha_deg, step.beta_deg, plan.session.mount) for plan in captured for step in plan.steps]
    assert steps == [(p["name"], p["alpha_deg"], p["beta_deg"], p["mount"]) for p in record["positions"]]
    assert all(plan.dwell.seconds == 60.0 and plan.dwell.settle_s == 10.0 for plan in captured)
    turned = {plan.session.mount: plan.positions.mount_rotation_deg for plan in captured}
    assert turned == {"A": [0, 0, 0], "B": [0, 0, 90]}

    # A calibration at nominal parameters: visits with their repeatability and prior, random walk and drift included.
    rig = read_rig_with_effects(folder / "rig.toml", catalogue())
    assert tomllib.loads((folder / "rig.toml").read_text())["truth"].keys() == {"dbeta"}
    data = simulated(replace(rig, truth={}, ability=None), 0, 0.0)
    fitted = fit(read_model(ModelOptions(rig=folder / "rig.toml")).problem(data))
    for name, stated in record["parameters"].items():
        assert fitted.sd[fitted.names.index(name)] == pytest.approx(stated["u"], rel=1e-6), name
    assert data.time_s == pytest.approx([position["start_s"] + 30.0 for position in record["positions"]])

    assert tumblecal(*simulate).code == 0 and tumblecal(*calibrate, "--no-figures").code == 0
    stated = json.loads((tmp_path / "calibration" / "result.json").read_text())["methods"]["exact"]["parameters"]
    for name, each in record["parameters"].items():
        assert stated[name]["sd"] == pytest.approx(each["u"], rel=3e-3), name

    # Two captures, one for each mounting, each with its clock: one calibration states the planned uncertainties.
    lines = (tmp_path / "simulated.csv").read_text().splitlines()
    header, *rows = (line for line in lines if not line.startswith("#"))
    columns = header.split(",")
    for mount, names in (("A", "capture_A.csv"), ("B", "capture_B.csv")):
        mounted = [dict(zip(columns, row.split(","), strict=True)) for row in rows]
        mounted = [row for row in mounted if row["mount"] == mount]
        first = float(mounted[0]["time_s"])
        zero = f"# time_zero: {datetime.fromtimestamp(1.8e9 + first, UTC).isoformat()}"
        own = [",".join((row | {"time_s": str(float(row["time_s"]) - first)}).values()) for row in mounted]
        (tmp_path / names).write_text("\n".join([zero, header, *own]) + "\n")
    joined = ("--join", "capture_B.csv", "capture_A.csv", "--rig", "plan/rig.toml", "--no-figures")
    outcome = tumblecal("calibrate", *joined, "--out", "both")
    assert outcome.code == 0 and not any("plan/rig.toml" in line for line in outcome.lines), outcome.lines
    stated = json.loads((tmp_path / "both" / "result.json").read_text())["methods"]["exact"]["parameters"]
    for name, each in record["parameters"].items():
        assert stated[name]["sd"] == pytest.approx(each["u"], rel=3e-3), name
    suggestion = next(line for line in designed.out.splitlines() if "tumblecal calibrate" in line)
    # A diagnosis proposes positions at visits that are not measured yet.
    outcome = tumblecal("diagnose", *joined, "--out", "found")
    assert outcome.code == 0 and "ADEQUATE" in outcome.out, outcome.lines
    # The mountings in the order of the plan; which of two equal ones comes first is a matter of rounding.
    runs = " ".join(
        f"run_{mount}/positions.csv" for mount in dict.fromkeys(each["mount"] for each in record["positions"])
    )
    assert runs.count("run_") == 2 and f"calibrate --join {runs} --rig plan/rig.toml" in suggestion
