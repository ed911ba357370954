"""Sweeps, the coverage studies that they are made of, and power studies."""

import numpy as np
import pytest

from tumblecal.ground.errors import InputError
from tumblecal.studies.run import run
from tumblecal.studies.study_tables import read_study
from tumblecal.studies.sweep import points_of


pytestmark = pytest.mark.usefixtures("quickly_compiled")


def test_raw_samples_and_drawn_means_agree(tmp_path, configs):
    head = f'schema = "tumblecal.study.coverage/1"\nrig = "{configs / "paper24.toml"}"\ntrials = 320\nseed = 3\n'
    noise = '[noise]\nwhite = "0.5 mg"\nrandom_walk = "0.02 mg"\nquantisation = "0.2 mg"\n'
    path = tmp_path / "study.toml"
    path.write_text(head + noise + 'rate = "10 Hz"\ndwell = "4 s"\nmove = "1 s"\n')
    sds = []
    for changes in ({"raw": True}, {}):
        study = read_study(path, "coverage", changes)
        content, frames = run(study, tmp_path / str(len(sds)))
        assert content["trials"] == 320 and content["failed"] == 0
        sds.append(frames["parameters"]["sd"].to_numpy())
    # Two samples of 320: the ratio of their sds has a relative sd of sqrt(1/320); 15 of them, 5 sd.
    assert np.max(np.abs(sds[0] / sds[1] - 1)) < 5 * np.sqrt(1 / 320)


def test_sweep_points_are_coverage_studies(tmp_path, configs):
    study = read_study(configs / "study_sweep.toml", "sweep", {"trials": 2000})
    points = points_of(study)
    assert len(points) == 12 and points[1][0] == {"rig.noise.sd": "0.05 mg", "study.inject.second_order.y": 0.1}
    assert points[1][1]["study"]["inject"] == {"second_order.y": 0.1}
    study["study"]["grid"] = {
        "rig.noise.sd": ["0.1 mg", "oops"],
        "rig.plan.gamma_deg": [1],
        "beta": [2],
        "study.noise.sd": ["0 mg"],
    }
    with pytest.raises(InputError) as caught:
        points_of(study)
    here = configs / "study_sweep.toml"
    assert caught.value.faults == (
        f"{here}: grid.rig.plan.gamma_deg = 1: plan.gamma_deg: unknown key; did you mean alpha_deg?",
        f"{here}: grid.beta = 2: a path starts with rig. or study., such as rig.noise.sd",
        f"{here}: grid.study.noise.sd = '0 mg': noise.sd: '0 mg': a standard deviation must be above 0 (1e-12 to 1e6 g)",
        f"{here}: grid.rig.noise.sd = 'oops': noise.sd: 'oops' is not a number with a unit, such as '1 mg'",
    )


@pytest.mark.usefixtures("few_effects")
def test_power_is_nothing_at_size_zero_and_all_at_a_gross_one(configs):
    from tumblecal.studies.power import Power

    study = read_study(configs / "study_power.toml", "power", {"runs": 2})
    study["study"]["effects"] = {"second_order.z": [0, 5.0]}
    power = Power(study)
    assert power.chunks == 2 and power.trials == 4
    _, frames = power.summary([power.compute(chunk) for chunk in range(2)])
    quiet, loud = frames["rates"].iter_rows(named=True)
    assert loud["detected"] == loud["named"] == 1.0 and quiet["failed"] == loud["failed"] == 0
    assert quiet["named_alone"] == 0.0 and quiet["unit"] == "mg/g^2"


def test_too_large_a_study_is_refused_before_it_starts(tumblecal, tmp_path, configs):
    given = ("study", "sweep", configs / "study_sweep.toml", "--out", tmp_path / "out")
    told = tumblecal(*given, "--trials", 10**12)
    assert told.code == 2 and "--max-hours" in told.lines[0] and "chunks" in told.out
    assert not (tmp_path / "out").exists()
    dry = tumblecal(*given, "--dry-run")
    assert (
        dry.code == 0 and "240000 trials in 12 chunks" in " ".join(dry.out.split()) and not (tmp_path / "out").exists()
    )
