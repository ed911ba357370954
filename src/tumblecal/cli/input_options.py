"""How the files of `tumblecal diagnose` are related to each other, and to raw samples."""

from pathlib import Path
from typing import Annotated

from tumblecal.cli.model_options import ModelOptions
from tumblecal.cli.options import Count, options, within
from tumblecal.cli.position_files import PositionFiles
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import pairs


@options
class InputOptions:
    """Relation of the files to each other, and to raw samples.

    Parameters
    ----------
    samples
        Raw samples of the position means: folder of tumblecal capture, or table (.csv, .parquet) with columns position,
        ax_g, ay_g, az_g, time_s. Their noise, including its slow part, weights the positions. With --join: one table for
        all files. Default: none. Example: --samples run1.
    units
        Files of different units (triads), measured on one dividing head: separates errors of the head from those of each
        sensor, and writes head.toml for --head. Example: diagnose A1.csv A2.csv --units.
    holdout
        Data held out of the fit to measure the improvement: a run, a mounting or positions. Default: each run, or
        each position, in turn. Example: --holdout run=3.
    workers
        Number of worker processes for a batch. Default: one for every 40 files, at most one for each core. Example:
        --workers 2.
    max_rows
        Largest number of positions used without averaging. If there are more, repeats are averaged; more than 1000 after
        averaging are rejected with an estimate of the cost, unless this option allows them. Default: 400. Example:
        --max-rows 2000.
    """

    samples: Path | None = None
    units: bool = False
    holdout: str | None = None
    workers: Count | None = None
    max_rows: Annotated[int | None, within(gte=3)] = None

    def require(self, model: ModelOptions, files: PositionFiles) -> None:
        """Check that the options fit together.

        **Raises:** `InputError`.
        """
        if self.units and (files.joining.join or model.head is not None):
            raise InputError(
                "--units treats each file as a different triad on a head of unknown errors; give it without --join and --head"
            )
        if self.units and files.single:
            raise InputError("--units: only one file; give the files of at least two units to find their common errors")
        if self.samples is not None and model.noise_sd is not None:
            raise InputError("--samples and --noise-sd both state the noise; give only one of these options")
        if self.samples is not None and not files.single:
            raise InputError("--samples is for one position file, but several are given; diagnose each file separately")

    def held_out(self) -> tuple[str, str] | None:
        """Column and value of the held-out data, if they are stated."""
        return next(iter(pairs("--holdout", [self.holdout or ""], "run=3").items()), None)
