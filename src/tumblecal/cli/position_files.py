"""The position files of one call of calibrate or diagnose, with their output folders."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.command import Command
from tumblecal.cli.model_options import ModelOptions
from tumblecal.cli.options import ResultOptions, Texts, options
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.data.overwriting import Results

SUMMARY = "summary.csv"


@options
class JoinOptions:
    """Several files as one measurement.

    Parameters
    ----------
    join
        Files joined into one measurement. Each file without a column run is a separate run, so a pitch setting may differ
        between files by more than the noise; the files of one designed plan (--rig DIR/rig.toml) are one run. Example:
        day1.csv day2.csv --join.
    same_run
        With --join: one run for all files without a column run, for example the first positions and the proposed ones.
        Example: --join --same-run.
    pause
        With --join: time from the last position of a file to the first of the next, once for all files or once for each
        later file; `unknown`; or `none` if one clock runs through all files. Default: from the comments time_zero, or
        from time_s if it continues; otherwise unknown. Example: --pause '2 h'.
    """

    join: bool = False
    same_run: bool = False
    pause: Texts = ()


class PositionFiles:
    """The files of a call with their output folders: `out` for a single measurement, otherwise a subfolder for each.

    **Raises:** `InputError` for options that contradict each other.
    """

    def __init__(self, command: Command, joining: JoinOptions, more: ResultOptions, files: list[Path], out: Path):
        if (joining.same_run or joining.pause) and not joining.join:
            raise InputError(f"--{'same-run' if joining.same_run else 'pause'} is for joined files only; add --join")
        self.command, self.joining, self.more, self.out = command, joining, more, out
        self.single = joining.join or len(files) == 1
        self.given, self.files = files, files[:1] if joining.join else files
        self.folders = [out] if self.single else list[Path]()
        if not self.single:
            from tumblecal.data.joined import unused

            for path in files:
                self.folders.append(out / unused(path.stem, [folder.name for folder in self.folders], "-"))

    def protect(self, options: ModelOptions, written: "Results", names: Sequence[str], *others: Path | None) -> None:
        """Check, before the work begins, that nothing is overwritten that must be kept, and that the history can be used.

        **Arguments:**

        - `written`, `names`: kind and files of the results. `others`: files that the command reads in addition.

        **Raises:** `InputError`.
        """
        from tumblecal.data.overwriting import protect_inputs, protect_other_results

        inputs, folders = [*self.given, *options.files, self.more.history, *others], [*self.folders, self.out]
        protect_inputs(inputs, folders=folders, names=(*names, SUMMARY))
        protect_other_results(written, folders)
        self.more.require_history()
