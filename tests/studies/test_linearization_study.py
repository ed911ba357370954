"""Bias of the linear equations against single fits."""

import numpy as np
import pytest

from tumblecal.estimation import harmonic, problem_of
from tumblecal.studies.linearization import Linearization
from tumblecal.studies.study_tables import read_study


pytestmark = pytest.mark.usefixtures("quickly_compiled")


def test_linear_bias_of_one_instrument(configs):
    """Against `harmonic.fit` on readings of the exact chain, the study's own draw repeated."""
    import jax

    from tumblecal.chain.rig_file import read_rig
    from tumblecal.data import PositionSet
    from tumblecal.simulation.experiment import BLOCK

    changes = {"instruments": 2, "sizes": 3, "smallest": "1 mrad", "largest": "10 mrad", "seed": 5}
    study = Linearization(read_study(configs / "study_linearization.toml", "linearization", changes))
    chunk = 2  # the first case (mount), its largest size
    found = study.compute(chunk)
    key = jax.random.fold_in(jax.random.key(5), 0)
    spread = np.zeros(15)
    spread[6:9] = 0.01
    truth = spread[:, None] * np.asarray(jax.random.normal(key, (15, BLOCK)))[:, :2]
    rig = read_rig(configs / "paper24.toml")
    biases = []
    for column in truth.T:
        readings = np.asarray(rig.chain(rig.where).at(column)(rig.where))
        plan = rig.plan
        data = PositionSet(plan.names, np.array(plan.alpha_deg), np.array(plan.beta_deg), readings)
        biases.append(harmonic.fit(problem_of(data)).values - column)
    np.testing.assert_allclose(found["bias"][0], np.sum(biases, axis=0), rtol=0, atol=1e-13)
