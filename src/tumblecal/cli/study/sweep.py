"""`tumblecal study sweep`."""

from pathlib import Path

from tumblecal.cli.options import EffectFiles
from tumblecal.cli.study.running import Running, Seed, run_study


def sweep(
    config: Path, /, *, trials: int | None = None, seed: Seed = None, effects: EffectFiles = (), running: Running
) -> None:
    """Run a coverage study at every point of a grid.

    Parameters
    ----------
    config
        Study file (TOML), such as configs/study_sweep.toml.
    trials
        Number of trials at each point. Default: that of the file. Example: --trials 1000.
    """
    run_study("sweep", config, {"trials": trials, "seed": seed}, running, effects)
