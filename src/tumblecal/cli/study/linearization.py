"""`tumblecal study linearization`."""

from pathlib import Path

from tumblecal.cli.options import EffectFiles
from tumblecal.cli.study.running import Running, run_study


def linearization(
    config: Path,
    /,
    *,
    instruments: int | None = None,
    seed: int | None = None,
    effects: EffectFiles = (),
    running: Running,
) -> None:
    """Find up to which errors the small-angle equations are good enough.

    Parameters
    ----------
    config
        The study, a TOML file such as configs/study_linearization.toml.
    instruments
        Number of random instruments for each size; goes before the file's.
    seed
        Seed of all random numbers; goes before the file's.
    running
        How it is run.
    """
    run_study("linearization", config, {"instruments": instruments, "seed": seed}, running, effects)
