"""Bias of the linear equations."""

import numpy as np
import polars as pl
import pytest

from tumblecal.studies.linearization import Linearization
from tumblecal.studies.study_tables import read_study


pytestmark = pytest.mark.usefixtures("quickly_compiled")


def test_linear_bias_is_quadratic_and_none_of_pitch_errors(configs):
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
