"""`tumblecal study convergence`."""

from pathlib import Path

from tumblecal.cli.options import EffectFiles
from tumblecal.cli.study.running import Running, Seed, run_study


def convergence(
    config: Path, /, *, runs: int | None = None, seed: Seed = None, effects: EffectFiles = (), running: Running
) -> None:
    """Find how many data sets each method needs to reach a given error.

    Parameters
    ----------
    config
        The study, a TOML file such as configs/study_convergence.toml.
    runs
        Number of runs; goes before the file's.
    """
    run_study("convergence", config, {"runs": runs, "seed": seed}, running, effects)
