"""`tumblecal study`: the command of each kind of study."""

from pathlib import Path

from tumblecal.cli.commands.study.running import run_study
from tumblecal.cli.commands.study.study_options import Number, Running


def coverage(
    config: Path,
    /,
    *,
    trials: Number = None,
    raw: bool = False,
    running: Running,
) -> None:
    """Check estimates and their stated uncertainties: estimation bias, dispersion, chi2, interval coverage.

    Parameters
    ----------
    config
        Study file (TOML), such as configs/study_coverage.toml.
    trials
        Number of trials. Default: that of the file. Example: --trials 10000.
    raw
        Simulation of each sample of each dwell, instead of position means with their exact covariance.
    """
    run_study("coverage", config, {"trials": trials, "raw": raw or None}, running)


def convergence(config: Path, /, *, runs: Number = None, running: Running) -> None:
    """Find the number of data sets that each method needs for a given error.

    Parameters
    ----------
    config
        Study file (TOML), such as configs/study_convergence.toml.
    runs
        Number of runs. Default: that of the file. Example: --runs 100.
    """
    run_study("convergence", config, {"runs": runs}, running)


def linearization(config: Path, /, *, instruments: Number = None, running: Running) -> None:
    """Find the largest errors for which the small-angle equations are adequate.

    Parameters
    ----------
    config
        Study file (TOML), such as configs/study_linearization.toml.
    instruments
        Number of random instruments for each size. Default: that of the file. Example: --instruments 50.
    """
    run_study("linearization", config, {"instruments": instruments}, running)


def power(config: Path, /, *, runs: Number = None, running: Running) -> None:
    """Find how often the diagnosis detects effects of given sizes, and identifies them correctly.

    Parameters
    ----------
    config
        Study file (TOML), such as configs/study_power.toml.
    runs
        Number of runs for each effect and size. Default: that of the file. Example: --runs 100.
    """
    run_study("power", config, {"runs": runs}, running)


def sweep(config: Path, /, *, trials: Number = None, running: Running) -> None:
    """Run a coverage study at every point of a grid.

    Parameters
    ----------
    config
        Study file (TOML), such as configs/study_sweep.toml.
    trials
        Number of trials at each point. Default: that of the file. Example: --trials 1000.
    """
    run_study("sweep", config, {"trials": trials}, running)
