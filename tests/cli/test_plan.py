"""`tumblecal plan`: its files, the chain to a calibration, and input that is rejected."""

import json
import re
import tomllib
from dataclasses import replace

import pytest

from tumblecal.capture.capture_plan import read_plan
from tumblecal.cli.model_options import StatedModel
from tumblecal.cli.options import ModelOptions
from tumblecal.effects.catalogue import catalogue, read_rig_with_effects
from tumblecal.estimation.exact import fit
from tumblecal.simulation.position_means import simulated


def test_the_files_of_a_plan_and_the_uncertainties_of_their_calibration(tumblecal, configs, tmp_path):
    mine = tmp_path / "plan_mine.toml"
    mine.write_text("# not of this command")
    outcome = tumblecal("plan", configs / "plan_head.toml", "--positions", "20", "--no-forecast", "--out", tmp_path)
    assert outcome.code == 0, outcome.lines
    assert re.search(r"^20 positions in 2 mountings", outcome.out, re.MULTILINE)
    assert "</html>" in (tmp_path / "plan.html").read_text() and mine.exists()
    record = json.loads((tmp_path / "plan.json").read_text())
    assert record["schema"] == "tumblecal.plan/1" and len(record["positions"]) == 20

    captured = [read_plan(tmp_path / name) for name in record["files"] if name != "rig.toml"]
    steps = [(step.name, step.alpha_deg, step.beta_deg, plan.session.mount) for plan in captured for step in plan.steps]
    assert steps == [(p["name"], p["alpha_deg"], p["beta_deg"], p["mount"]) for p in record["positions"]]
    assert all(plan.dwell.seconds == 60.0 and plan.dwell.settle_s == 10.0 for plan in captured)
    assert {plan.session.mount: plan.positions.mount_rotation_deg for plan in captured} == {
        "A": [0, 0, 0],
        "B": [0, 0, 90],
    }

    # A calibration at nominal parameters: visits with their repeatability and prior, random walk and drift included.
    rig = read_rig_with_effects(tmp_path / "rig.toml", catalogue())
    assert tomllib.loads((tmp_path / "rig.toml").read_text())["truth"].keys() == {"dbeta"}
    data = simulated(replace(rig, truth={}, ability=None), 0, 0.0)
    fitted = fit(StatedModel.of(ModelOptions(rig=tmp_path / "rig.toml")).problem(data))
    for name, stated in record["parameters"].items():
        assert fitted.sd[fitted.names.index(name)] == pytest.approx(stated["u"], rel=1e-6), name
    assert data.time_s == pytest.approx([position["start_s"] + 30.0 for position in record["positions"]])
