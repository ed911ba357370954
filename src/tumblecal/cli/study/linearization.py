"""`tumblecal study linearization`."""

from pathlib import Path

from tumblecal.cli.options import EffectFiles
from tumblecal.cli.study.running import Running, Seed, run_study


def linearization(
    config: Path, /, *, instruments: int | None = None, seed: Seed = None, effects: EffectFiles = (), running: Running
) -> None:
    """Find the largest errors for which the small-angle equations are adequate.

    Parameters
    ----------
    config
        Study file (TOML), such as configs/study_linearization.toml.
    instruments
        Number of random instruments for each size. Default: that of the file. Example: --instruments 50.
    """
    run_study("linearization", config, {"instruments": instruments, "seed": seed}, running, effects)
