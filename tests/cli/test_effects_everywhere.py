"""An effect of the user's own takes part in every command that knows effects."""

import json
import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import independent


pytestmark = pytest.mark.usefixtures("few_effects")


DOCUMENT = Path(__file__).parents[2] / "docs" / "own_effects.md"
RIG = """schema = "tumblecal.rig/1"
[plan]
alpha_deg = { start = 0, step = 45, count = 8 }
beta_deg = [0, 45, 90]
[chain]
effects = ["index_third"]
[truth]
index_third = { value = [0.8, -0.6], unit = "mrad" }
[noise]
sd = "0.1 mg"
"""


@pytest.fixture
def mine(tmp_path):
    """The document's effect of an angle, and a rig that has it."""
    texts = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.S)
    (tmp_path / "rig.toml").write_text(RIG)
    path = tmp_path / "mine.py"
    path.write_text(next(text for text in texts if "angle_effect(" in text))
    return path


def test_simulate_calibrate_diagnose(tumblecal, tmp_path, mine):
    data, rig = tmp_path / "data.csv", tmp_path / "rig.toml"
    assert tumblecal("simulate", rig, "--effects", mine, "--out", data, "--seed", 2).code == 0
    table = pl.read_csv(data, comment_prefix="#")
    alpha, beta = np.radians(table["alpha_deg"].to_numpy()), np.radians(table["beta_deg"].to_numpy())
    error = 0.8e-3 * np.cos(3 * alpha) - 0.6e-3 * np.sin(3 * alpha)
    rest = table.select("ax_g", "ay_g", "az_g").to_numpy() - independent.specific_force(alpha + error, beta)
    assert np.sqrt(np.mean(rest**2)) == pytest.approx(1e-4, rel=0.25)

    options = ["--rig", rig, "--effects", mine, "--prior", "index_third=5 mrad"]
    assert tumblecal("calibrate", data, *options, "--no-figures", "--out", tmp_path / "fit").code == 0
    fitted = json.loads((tmp_path / "fit" / "result.json").read_text())["methods"]["exact"]["parameters"]
    for name, value in (("index_third_cos", 0.8e-3), ("index_third_sin", -0.6e-3)):
        assert abs(fitted[name]["value"] - value) < 4 * fitted[name]["sd"] < 3e-4

    assert tumblecal("diagnose", data, "--effects", mine, "--out", tmp_path / "found", "--no-figures").code == 0
    found = json.loads((tmp_path / "found" / "diagnosis.json").read_text())
    assert found["verdict"] == "identified" and found["causes"] == ["index_third"]
    size = found["explanations"][0]["coefficients"]["index_third_cos"]
    assert size["unit"] == "mrad" and abs(size["value"] - 0.8) < 4 * size["sd"]
    assert found["next_plan"]["together"] and "three times round" in " ".join(found["text"].split())
    assert json.loads((tmp_path / "found" / "calibration.json").read_text())["provenance"]["causes"] == ["index_third"]


def test_effects_lists_and_explains_it(tumblecal, mine):
    assert "index_third" in tumblecal("effects", "--effects", mine).out
    assert "three times round" in tumblecal("effects", "index_third", "--effects", mine).out
    assert tumblecal("effects", "index_third").code == 2
