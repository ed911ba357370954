"""Coverage of intervals: estimation bias, standard deviations and intervals over simulated calibrations, in constant memory."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from tumblecal.chain import Chain
from tumblecal.estimation.problem import Problem
from tumblecal.ground.errors import InputError
from tumblecal.simulation.experiment import BLOCK, Experiment, experiment_of
from tumblecal.simulation.samplers import Sampler
from tumblecal.simulation.sums import LEVELS, Sums, added, chunk_sums


if TYPE_CHECKING:
    import polars as pl


# Trials in a chunk: what one call of a program computes, and a study stores or hands to a worker.
CHUNK = 64 * BLOCK


def coverage(
    problem: Problem,
    trials: int,
    *,
    seed: int = 0,
    truth: Sampler | None = None,
    noise: Sampler | None = None,
    simulated: Chain | None = None,
    path: str = "auto",
) -> "pl.DataFrame":
    """Shares of simulated calibrations whose intervals contain the true values, for any chain, plan, noise and samplers.

    The trials are those of `monte_carlo` with the same arguments, but only their sums are kept: memory does not grow with
    their number. `tumblecal study coverage` is the same calculation in chunks that are stored and can be distributed.

    **Arguments:** as of `monte_carlo`.

    **Returns:** a row for each parameter, base units:

    - `truth` (of the problem's chain), `predicted_sd`, `bias` (mean of estimate minus truth) with its standard error `bias_se`,
      `sd` of estimate minus truth, `sd_over_predicted`.
    - `covered_95_stated`: share of the 95 % intervals that contain the truth, with the stated noise (normal quantiles; no such
      column if the noise is unknown); `covered_95_estimated`: with the noise of each fit (Student's t; no such column
      without degrees of freedom). The same for 68 and 99 %.
    - `trials`; `failed`: number of those that did not converge and are not in the shares.

    **Raises:** as `monte_carlo`.

    Examples:
        >>> import jax
        >>> import numpy as np
        >>> from tumblecal import Problem
        >>> from tumblecal.chain import nominal_chain, settings
        >>> from tumblecal.simulation import coverage
        >>> where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))
        >>> problem = Problem.from_arrays(nominal_chain(where), where, np.zeros((24, 3)), noise_sd=1e-4)
        >>> table = coverage(problem, 4096, truth=lambda key: 1e-3 * jax.random.t(key, 4.0, (15,)))
        >>> bool(abs(table["covered_95_stated"].mean() - 0.95) < 0.01)
        True
    """
    import polars as pl

    if trials < 1:
        raise InputError(f"trials {trials}: must be at least 1")
    one = experiment_of(problem, simulated=simulated, draw_truth=truth, draw_noise=noise, path=path)
    sums_of_chunk = chunk_sums(one, seed)
    sums = total_of(sums_of_chunk(first, min(first + CHUNK, trials)) for first in range(0, trials, CHUNK))
    table = coverage_table(one, sums)
    if one.dof < 1:
        table = table.drop(f"covered_{round(100 * level)}_estimated" for level in LEVELS)
    if not problem.known:  # predicted for 1 mg: the noise of the fits is the level
        level = np.sqrt(float(sums.chi2 / (sums.trials - sums.failed)) / one.dof) if one.dof else np.nan
        table = table.with_columns(pl.col("predicted_sd") * level, pl.col("sd_over_predicted") / level)
        table = table.drop(f"covered_{round(100 * share)}_stated" for share in LEVELS)
    return table.with_columns(pl.lit(trials).alias("trials"), pl.lit(int(sums.failed)).alias("failed"))


def total_of(chunks: Iterable[Sums]) -> Sums:
    """All chunks together, added in their order."""
    total: Sums | None = None
    for sums in chunks:
        total = sums if total is None else added(total, sums)
    if total is None:
        raise ValueError("there is at least one chunk")
    return total


def coverage_table(experiment: Experiment, sums: Sums) -> "pl.DataFrame":
    """Bias, standard deviations and coverage of each parameter, from the sums over the trials."""
    import polars as pl

    n = float(sums.trials - sums.failed)
    sd = np.sqrt(np.diag(experiment.covariance))
    z_mean = np.asarray(sums.error) / n
    z_sd = np.sqrt(np.maximum(np.diag(sums.products) / n - z_mean**2, 0.0) * n / max(n - 1, 1))
    columns: dict[str, Any] = {
        "parameter": list(experiment.names),
        "unit": list(experiment.units),
        "truth": experiment.truth,
        "predicted_sd": sd,
        "bias": z_mean * sd,
        "bias_se": z_sd * sd / np.sqrt(n),
        "sd": z_sd * sd,
        "sd_over_predicted": z_sd,
    }
    for kind, name in enumerate(("stated", "estimated")):
        for row, level in enumerate(LEVELS):
            columns[f"covered_{round(100 * level)}_{name}"] = np.asarray(sums.covered)[kind, row] / n
    return pl.DataFrame(columns)
