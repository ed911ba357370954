"""`tumblecal study coverage`."""

from pathlib import Path

from tumblecal.cli.options import EffectFiles
from tumblecal.cli.study.running import Running, Seed, run_study


def coverage(
    config: Path,
    /,
    *,
    trials: int | None = None,
    seed: Seed = None,
    raw: bool = False,
    effects: EffectFiles = (),
    running: Running,
) -> None:
    """Check estimates and their stated uncertainties: estimation bias, dispersion, chi2, interval coverage.

    Parameters
    ----------
    config
        Study file (TOML), such as configs/study_coverage.toml.
    trials
        Number of trials. Default: that of the file. Example: --trials 10000.
    raw
        Simulation of each sample of each dwell, instead of position means with their exact covariance.
    """
    run_study("coverage", config, {"trials": trials, "seed": seed, "raw": raw or None}, running, effects)
