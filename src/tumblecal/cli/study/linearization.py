"""`tumblecal study linearization`."""

from pathlib import Path

from tumblecal.cli.options import EffectFiles
from tumblecal.cli.study.running import Running, Seed, run_study


def linearization(
    config: Path, /, *, instruments: int | None = None, seed: Seed = None, effects: EffectFiles = (), running: Running
) -> None:
    """Find up to which errors the small-angle equations are good enough.

    Parameters
    ----------
    config
        The study, a TOML file such as configs/study_linearization.toml.
    instruments
        Number of random instruments for each size; goes before the file's.
    """
    run_study("linearization", config, {"instruments": instruments, "seed": seed}, running, effects)
