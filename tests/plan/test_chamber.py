"""Plans over the temperatures of a chamber: a calibration states the uncertainties of the plan."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.chain.rig_file import rig_of
from tumblecal.effects import catalogue
from tumblecal.estimation.exact import fit
from tumblecal.estimation.stated_model import StatedModel
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import Cells, Positions
from tumblecal.plan.design import design_plan
from tumblecal.plan.plan_files import capture_files, capture_text, rig_text
from tumblecal.plan.request import Wanted
from tumblecal.show.plan import words_of_plan
from tumblecal.simulation.position_means import simulated


RIG = tomllib.loads("""
schema = "tumblecal.rig/1"
[plan]
alpha_deg = { start = 0, step = 90, count = 4 }
beta_deg = [0, 45]
mounts = ["A"]
[chain.leaves]
dbeta = { by = "mount.pitch" }
dtheta = { by = "mount" }
[mounts]
A = { rotation_deg = [0, 0, 0] }
B = { rotation_deg = [0, 0, 90] }
[temperature.bias]
order = 1
truth = { x = ["0.1 mg/degC"] }
[temperature.dK]
order = 1
[noise]
sd = "0.15 mg"
[priors]
dbeta = "3 arcmin"
[head]
alpha_deg = { start = 0, step = 90, count = 4 }
beta_deg = [-45, 0, 45]
mounts = ["A"]
temperatures_degc = [0, 50]
times = { remount_s = 600 }
repeatability = { pitch = "30 arcsec" }
""")
TWO = RIG | {"head": RIG["head"] | {"mounts": ["A", "B"]}}
ANGLES = [(0, 0), (90, 0), (180, 0), (270, 0), (0, 45), (180, 45)]
MEASURED = Positions("measured.csv", "", Cells.listed([(*pair, "A") for pair in ANGLES], (24.9, 25.1) * 3))


def fitted(rig):
    """Uncertainties of a calibration of data at nominal parameters."""
    model = StatedModel(rig=rig, noise_sd=rig.noise_sd_g, priors=rig.priors)
    none = replace(rig, truth={}, temperature=replace(rig.temperature, leaves=dict.fromkeys((), None)))
    data = simulated(replace(none, ability=None), 0, 0.0)
    found = fit(model.problem(data))
    return dict(zip(found.names, found.sd, strict=True))


@pytest.mark.long
@pytest.mark.parametrize(
    ("content", "wanted"),
    [
        (TWO, Wanted(positions=12, restarts=1)),
        pytest.param(RIG, Wanted(positions=8, restarts=1, order="keep", measured=MEASURED), marks=pytest.mark.long),
    ],
    ids=["mountings", "augmented"],
)
def test_a_calibration_states_the_uncertainties_of_a_plan_in_a_chamber(content, wanted):
    plan = design_plan(rig_of(content, Path("rig.toml")), replace(wanted, forecast=False), catalogue())
    degc = np.asarray(plan.cells.temperature_degc, float)
    # Measured temperatures are those of one soak. Each new temperature is set once.
    assert {*degc} == ({0.0, 25.0, 50.0} if wanted.measured else {0.0, 50.0})
    assert np.count_nonzero(np.diff(degc)) == len({*degc}) - 1
    assert {"bias_T_x1", "dK_T_z1"} <= {*plan.after.compared} == {*plan.after.uncertainties.names}
    # The range of the chamber is written, so that a calibration has the same functions of temperature.
    rig = rig_of(tomllib.loads(rig_text(plan, content)), Path("rig.toml"))
    assert (rig.temperature.reference_degc, rig.temperature.range_degc) == (25.0, (0.0, 50.0))
    stated = fitted(rig)
    for name, u in zip(plan.after.uncertainties.names, plan.after.uncertainties.sd.tolist(), strict=True):
        assert stated[name] == pytest.approx(u, rel=1e-5), name
    # The captures request the temperatures.
    listed = [
        step.temperature_degc
        for name in capture_files(plan)
        for step in CapturePlan.model_validate(tomllib.loads(capture_text(plan, name, Path("plan")))).steps
    ]
    assert listed == degc[plan.measured :].tolist()
    assert [float(row[-1]) for row in words_of_plan(plan, Path("plan")).blocks["positions"][1:]] == listed
    if not wanted.measured:
        assert all({*(each.positions.cells.temperature_degc)} == {0.0, 50.0} for each in plan.practice)


def test_measured_positions_without_temperatures_are_rejected():
    wanted = Wanted(
        positions=12, measured=replace(MEASURED, cells=replace(MEASURED.cells, temperature_degc=None)), forecast=False
    )
    with pytest.raises(InputError, match=r"measured.csv: no temperature_degc, but rig.toml has a chamber"):
        design_plan(rig_of(RIG, Path("rig.toml")), wanted, catalogue())
