"""Rigs from TOML: the configs that come with the program, and every fault at once."""

import math
import re

import numpy as np
import pytest

from tumblecal import InputError
from tumblecal.chain.rig_file import read_rig
from tumblecal.ground.frames import rotation_matrix


def test_paper_plan_and_truth(configs):
    from tumblecal.data import paper

    rig = read_rig(configs / "paper24.toml")
    table = paper.table1()
    assert rig.plan.names == table.names
    np.testing.assert_array_equal(rig.plan.alpha_deg, table.alpha_deg)
    np.testing.assert_array_equal(rig.plan.beta_deg, table.beta_deg)
    chain = rig.true_chain(rig.where)
    np.testing.assert_allclose(chain.vector, [paper.SIMULATION_TRUTH[name] for name in chain.names], rtol=1e-14)


def test_units_mounts_priors_and_leaves_reach_the_chain(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(
        """
schema = "tumblecal.rig/1"
[plan]
positions = [
  { alpha_deg = 0, beta_deg = 0, mount = "up" },
  { alpha_deg = 90, beta_deg = 45, mount = "side", name = "second", run = "2" },
]
[chain]
links = ["base", "pitch_axis", "spindle", "small_angle_mount", "triad", "output"]
[chain.leaves.bias]
by = "run"
[chain.leaves.dbeta]
free = false
[mounts.up]
rotation_deg = [0, 0, 0]
[mounts.side]
rotation_deg = [0, 90, 0]
[truth]
bias = { value = [1, 2, 3, 4, 5, 6], unit = "mg" }
gamma_32 = { value = 3, unit = "arcmin" }
[priors]
dtheta = "0.1 deg"
[noise]
sd = "200 ug"
"""
    )
    rig = read_rig(path)
    assert rig.plan.names == ("1", "second") and rig.plan.runs == ("1", "2")
    assert rig.noise_sd_g == pytest.approx(2e-4, rel=1e-15)
    assert rig.priors == {"dtheta": (0.0, pytest.approx(math.radians(0.1)))}
    chain = rig.true_chain(rig.where)
    assert not any(name.startswith("dbeta") for name in chain.names)
    value = dict(zip(chain.names, chain.vector, strict=True))
    assert value["bias_x@run=2"] == pytest.approx(4e-3) and value["bias_z@run=1"] == pytest.approx(3e-3)
    assert value["gamma_32"] == pytest.approx(3 * math.pi / 10800)
    assert "SmallAngleMount" in [type(link).__name__ for link in chain.links]
    (mount,) = [link for link in chain.links if type(link).__name__ == "SmallAngleMount"]
    np.testing.assert_allclose(mount.nominal[1], rotation_matrix(np.radians([0, 90, 0])))


def test_all_faults_of_a_config_are_told_at_once(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(
        """
schema = "tumblecal.rig/7"
colour = "red"
[plan]
alpha_deg = { start = 0, step = "x", count = 0 }
beta_deg = [0, inf]
[chain]
links = ["base", "elbow"]
[chain.leaves.dbeta]
fre = true
[noise]
sd = 3
[mounts.A]
rotation_deg = [0, 0]
"""
    )
    with pytest.raises(InputError) as refused:
        read_rig(path)
    faults = refused.value.faults
    links = "'base', 'pitch_axis', 'spindle', 'free_attitude', 'mount', 'small_angle_mount', 'triad' or 'output'"
    assert set(faults) == {
        f"{path}:line {where}"
        for where in (
            "2: schema: must be 'tumblecal.rig/1' (got 'tumblecal.rig/7')",
            "3: colour: unknown key; remove it or check its spelling",
            "5: plan.alpha_deg.step: must be a number (got 'x')",
            "5: plan.alpha_deg.count: must be 1 or more (got 0)",
            "6: plan.beta_deg.1: must be a finite number (got inf)",
            f"8: chain.links.1: must be {links} (got 'elbow')",
            "10: chain.leaves.dbeta.fre: unknown key; did you mean free?",
            "12: noise.sd: must be a text in quotation marks (got 3)",
            "14: mounts.A.rotation_deg: must have 3 or more entries, not 2",
        )
    }


def test_faults_of_meaning_are_told_at_once_too(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(
        """
schema = "tumblecal.rig/1"
[plan]
alpha_deg = [0, 90]
beta_deg = [0]
[chain]
effects = ["warp"]
[truth]
dK = { value = 1, unit = "mg" }
[priors]
dbeta = "3"
"""
    )
    with pytest.raises(InputError) as refused:
        read_rig(path)
    text = str(refused.value)
    for place in ("chain.effects", "truth.dK.unit", "priors.dbeta"):
        assert re.search(rf"{re.escape(str(path))}:line \d+: {re.escape(place)}", text), place


def test_data_with_an_undescribed_mount(configs):
    from tumblecal.chain import settings

    rig = read_rig(configs / "remount.toml")
    with pytest.raises(InputError, match=r"no entry for mount C of the data; add \[mounts\.C\]"):
        rig.chain(settings([0.0, 1.0], [0.0, 0.0], mount=["A", "C"]))
