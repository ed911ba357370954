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
    """Check whether estimates and their stated uncertainties can be trusted.

    Parameters
    ----------
    config
        The study, a TOML file such as configs/study_coverage.toml.
    trials
        Number of trials; goes before the file's.
    raw
        Draw every sample of every dwell instead of the position means, whose covariance is exact.
    """
    run_study("coverage", config, {"trials": trials, "seed": seed, "raw": raw or None}, running, effects)
