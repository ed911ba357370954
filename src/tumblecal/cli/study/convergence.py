"""`tumblecal study convergence`."""

from pathlib import Path

from tumblecal.cli.options import EffectFiles
from tumblecal.cli.study.running import Running, run_study


def convergence(
    config: Path,
    /,
    *,
    runs: int | None = None,
    seed: int | None = None,
    effects: EffectFiles = (),
    running: Running,
) -> None:
    """Find how many data sets each method needs to reach a given error.

    Parameters
    ----------
    config
        The study, a TOML file such as configs/study_convergence.toml.
    runs
        Number of runs; goes before the file's.
    seed
        Seed of all random numbers; goes before the file's.
    running
        How it is run.
    """
    run_study("convergence", config, {"runs": runs, "seed": seed}, running, effects)
