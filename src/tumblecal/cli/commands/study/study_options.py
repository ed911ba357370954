"""Options of all kinds of study."""

from pathlib import Path
from typing import Annotated

from tumblecal.cli.options import Count, EffectFiles, Seed, options, within


Number = Annotated[int | None, within(gte=2, lte=10**12)]


@options
class Running:
    """Seed, effects and execution of a study; how it is executed does not change its result.

    Parameters
    ----------
    out
        Output folder: finished chunks, JSON, Parquet and figures. An interrupted study in this folder is continued.
        Example: --out study1.
    seed
        Seed of all random numbers. Default: that of the file. Example: --seed 1.
    workers
        Number of worker processes on this machine (needs the cluster extra). Default: this process only. Example:
        --workers 4.
    scheduler
        Address of a running dask scheduler. Default: none. Example: --scheduler tcp://10.0.0.5:8786.
    dry_run
        Estimate of trials, chunks, hours and bytes only; no study is run.
    max_hours
        Largest estimated time, h; a longer study is rejected. Example: --max-hours 48.
    max_gib
        Largest estimated disk space, GiB; a larger study is rejected. Example: --max-gib 50.
    """

    out: Path
    seed: Seed | None = None
    effects: EffectFiles = ()
    workers: Count | None = None
    scheduler: str | None = None
    dry_run: bool = False
    max_hours: float = 24.0
    max_gib: float = 10.0
