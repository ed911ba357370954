"""Bias of the linear equations against single fits."""

import numpy as np
import polars as pl
import pytest

from tumblecal.estimation import harmonic, problem_of
from tumblecal.studies.linearization import Linearization
from tumblecal.studies.study_tables import read_study


pytestmark = pytest.mark.usefixtures("quickly_compiled")


def test_linear_bias_is_that_of_the_single_fit(configs):
    changes = {"instruments": 4, "sizes": 3, "smallest": "1 mrad", "largest": "10 mrad"}
    study = Linearization(read_study(configs / "study_linearization.toml", "linearization", changes))
    chunks = [study.compute(chunk) for chunk in range(study.chunks)]
    assert all(np.all(chunk["count"] == 4) for chunk in chunks)
    result, frames = study.summary(chunks)
    for slopes in result["slopes"].values():
        assert all(abs(slope - 2) < 0.05 for slope in slopes.values())
    # Pitch errors alone are exact in the small-angle chain: its first-order mount is then the exact one.
    pitch = frames["biases"].filter((pl.col("case") == "pitch") & (pl.col("path") == "small angle"))
    assert pitch["rms_bias"].to_numpy().max() < 1e-12
    assert len(result["answers"]) == 4 * 2 * 4


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
