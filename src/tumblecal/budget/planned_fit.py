"""The fit of a plan that is not measured yet."""

from dataclasses import replace

from tumblecal.estimation import Fit, exact
from tumblecal.estimation.stated_model import StatedModel
from tumblecal.ground.errors import InputError
from tumblecal.simulation.position_means import simulated


def planned_fit(model: StatedModel) -> Fit:
    """The fit of a plan at the true values of its rig, without measurement errors.

    **Raises:** `InputError` if the noise is not stated.
    """
    assert model.rig is not None
    if model.noise_sd is None:
        raise InputError(f'{model.rig.source}: noise.sd is missing; add [noise] sd = "0.1 mg" or give --noise-sd')
    return exact.fit(model.problem(simulated(replace(model.rig, effects=()), 0, noise_sd=1e-12)))
