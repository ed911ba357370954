"""`tumblecal study convergence`."""

from pathlib import Path

from tumblecal.cli.options import EffectFiles
from tumblecal.cli.study.running import Running, Seed, run_study


def convergence(
    config: Path, /, *, runs: int | None = None, seed: Seed = None, effects: EffectFiles = (), running: Running
) -> None:
    """Find the number of data sets that each method needs for a given error.

    Parameters
    ----------
    config
        Study file (TOML), such as configs/study_convergence.toml.
    runs
        Number of runs. Default: that of the file. Example: --runs 100.
    """
    run_study("convergence", config, {"runs": runs, "seed": seed}, running, effects)
