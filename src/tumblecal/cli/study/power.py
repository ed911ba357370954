"""`tumblecal study power`."""

from pathlib import Path

from tumblecal.cli.options import EffectFiles
from tumblecal.cli.study.running import Running, Seed, run_study


def power(
    config: Path, /, *, runs: int | None = None, seed: Seed = None, effects: EffectFiles = (), running: Running
) -> None:
    """Find how often the diagnosis detects effects of given sizes, and identifies them correctly.

    Parameters
    ----------
    config
        Study file (TOML), such as configs/study_power.toml.
    runs
        Number of runs for each effect and size. Default: that of the file. Example: --runs 100.
    """
    run_study("power", config, {"runs": runs, "seed": seed}, running, effects)
