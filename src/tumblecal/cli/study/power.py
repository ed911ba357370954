"""`tumblecal study power`."""

from pathlib import Path

from tumblecal.cli.options import EffectFiles
from tumblecal.cli.study.running import Running, Seed, run_study


def power(
    config: Path, /, *, runs: int | None = None, seed: Seed = None, effects: EffectFiles = (), running: Running
) -> None:
    """Find how often the diagnosis detects effects, and names them rightly, over their size.

    Parameters
    ----------
    config
        The study, a TOML file such as configs/study_power.toml.
    runs
        Number of runs of each effect and size; goes before the file's.
    """
    run_study("power", config, {"runs": runs, "seed": seed}, running, effects)
