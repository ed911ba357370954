"""Convergence studies against the recursion and against what means and covariances must be."""

import numpy as np
import polars as pl
import pytest

from tumblecal.estimation import kalman
from tumblecal.estimation.programs import compiler_options
from tumblecal.studies.convergence import CHUNK, Convergence
from tumblecal.studies.study_tables import read_study


pytestmark = pytest.mark.usefixtures("quickly_compiled")


@pytest.fixture(scope="module")
def convergence(configs) -> Convergence:
    changes = {"runs": 100, "data_sets": 40, "methods": ["single", "mean", "kalman", "exact"]}
    return Convergence(
        read_study(configs / "study_convergence.toml", "convergence", changes | {"prior_sd": [0.01, 1e-3]})
    )


def test_batched_kalman_is_the_recursion(convergence):
    import jax
    import jax.numpy as jnp

    generator = np.random.default_rng(0)
    z = convergence.ideal[:, None] + 1e-3 * generator.normal(size=(6, len(convergence.ideal), CHUNK))
    truth = jnp.zeros((15, CHUNK))
    estimates = jax.jit(convergence._estimates, compiler_options=compiler_options())
    prior = kalman.Prior(1e-3)
    place = [label for label, _, _ in convergence.methods].index("kalman, prior sd 0.001")
    history, _ = kalman.run(z[:, :, 5] - convergence.ideal, convergence.design, np.diag(convergence.variance), prior)
    total = jnp.zeros(z.shape[1:])
    for step in range(6):
        total = total + z[step]
        errors, _, nis, _ = estimates(step + 1.0, jnp.asarray(z[step]), total, truth)
        np.testing.assert_allclose(errors[place, :, 5], history.values[step], rtol=0, atol=1e-12)
        np.testing.assert_allclose(nis[place, 5], history.nis[step], rtol=1e-7)


def test_convergence_statistics(convergence):
    result, frames = convergence.summary([convergence.compute(0)])
    errors = frames["errors"].filter(pl.col("parameter") == "dK_y")
    rms = {m: errors.filter(pl.col("method") == m)["rms"].to_numpy() for m in result.methods}
    # sqrt(N) for the means, none for the single sets; 100 runs give the rms to 7 %, so 5 sd.
    assert rms["mean"][-1] == pytest.approx(rms["mean"][0] / np.sqrt(40), rel=0.5)
    assert rms["single"][-1] == pytest.approx(rms["single"][0], rel=0.5)
    last = frames["consistency"].filter(pl.col("data_sets") == 40)
    for method in ("single", "exact"):
        nees = last.filter(pl.col("method") == method)["nees"].item()
        assert abs(nees - 15) < 5 * np.sqrt(2 * 15 / 100), method
    nis = last.filter(pl.col("method") == "kalman, prior sd 0.01")["nis"].item()
    assert abs(nis - 27) < 5 * np.sqrt(2 * 27 / 100)
    exact = frames["needed"].filter((pl.col("method") == "exact") & (pl.col("threshold") == 1e-4))
    assert exact["median"].max() <= 40 and result.settled["exact"]["1e-05"].median_data_sets is None
