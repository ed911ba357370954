"""The position files of one call of calibrate or diagnose: read, joined if asked for, and their outcomes one after another."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from tumblecal.cli.command import NOT_USABLE, Command, names_written
from tumblecal.cli.options import ModelOptions, ResultOptions, Texts, options
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.chain.rig import Rig
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.data import PositionSet
    from tumblecal.data.overwriting import Results

    Read = PositionSet | InputError

SUMMARY = "summary.csv"
# Printed for joined files without a column mount, if something was found.
ONE_MOUNTING = (
    "Assumed: one mounting for all files. If the triad was removed from its fixture between them, add a column mount "
    "(such as A and B)."
)


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

    def joined(self, parts: "Sequence[PositionSet]", rig: "Rig | None") -> "tuple[PositionSet, list[str]]":
        """The positions of all files, and words on runs and pauses.

        **Raises:** `InputError` for files that do not belong together.
        """
        from tumblecal.data.joined import joined, with_separate_runs
        from tumblecal.data.joined_clocks import joined_clocks
        from tumblecal.estimation.mountings import with_distinct_mounts
        from tumblecal.estimation.planned_positions import indexed_by_visit

        serials = {part.serial_number: part.source for part in parts if part.serial_number}
        if len(serials) > 1:
            listed = ", ".join(f"{source} {serial}" for serial, source in serials.items())
            raise InputError(f"--join: serial numbers differ ({listed}); join the files of one unit only")
        planned = indexed_by_visit(rig)
        parts = list(parts) if rig else with_distinct_mounts(parts)
        parts = parts if self.same_run or planned else with_separate_runs(parts)
        clocks = joined_clocks(parts, self.pause)
        whole, words = joined(parts, clocks), [*(clocks.words if clocks else ())]
        if len(parts) < 2 or (whole.run is None and (whole.mount is not None or planned)):
            return whole, words  # each file has its own mounting, or all are those of a designed plan
        if whole.run is None:
            return whole, [f"Assumed: one run for all {len(parts)} files.", *words]
        runs = ", ".join(dict.fromkeys(whole.run))
        return whole, [f"Runs: {runs}. With --same-run, all files without a column run are one run.", *words]


class Outcome(NamedTuple):
    """The outcome for one file: its row of the summary, faults, and words; `show` prints the result of a single file."""

    row: dict[str, Any]
    faults: Sequence[str] = ()
    words: str = ""
    show: Callable[[], object] | None = None
    refused: bool = False


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

    def read(
        self,
        model: "StatedModel",
        options: ModelOptions,
        written: "Results",
        names: Sequence[str],
        *others: Path | None,
        together: bool = False,
        check_size: bool = True,
    ) -> "list[Read]":
        """The positions of each file, or of all files joined; nothing is overwritten that must be kept.

        **Arguments:**

        - `written`, `names`: kind and files of the results. `others`: further files that the command reads.
        - `together`: whether a file that cannot be read ends the command. `check_size`: of the readings.

        **Raises:** `InputError`.
        """
        from tumblecal.data.overwriting import protect_inputs, protect_other_results

        folders = [*self.folders, self.out]
        protect_inputs(
            [*self.given, *options.files, self.more.history, *others], folders=folders, names=(*names, SUMMARY)
        )
        protect_other_results(written, folders)
        if self.more.history is not None:
            from tumblecal.history.database import ready

            ready(self.more.history)
        read: list[Read] = model.read_each(self.given, together=together or self.single, check_size=check_size)
        if self.joining.join:
            whole, words = self.joining.joined([part for part in read if not isinstance(part, InputError)], model.rig)
            self.command.say(*words)
            read = [whole]
        model.compare_with_plan(read)
        return read

    def conclude(
        self,
        outcomes: Iterator[Outcome],
        columns: Sequence[str],
        names: Sequence[str],
        document: str,
        doing: str,
        last: Callable[[Sequence[dict[str, Any]]], None] = lambda rows: None,
    ) -> int:
        """Print each outcome when it is ready, and write the summary of several files.

        **Arguments:**

        - `columns`: of the summary. `names`, `document`: files of a result, and the one that is printed as JSON.
        - `last`: called with the rows of the summary, when all files are done.

        **Returns:** the exit code.

        **Raises:** `InputError` with the faults of all files.
        """
        from tumblecal.ground.result_set import remove_results
        from tumblecal.lab.summary import write_summary

        rows, faults, refused, count = list[dict[str, Any]](), list[str](), False, len(self.files)
        if not self.single:
            remove_results(self.out, (SUMMARY,))  # it describes the results before the first one is replaced
        try:
            for number, (file, folder) in enumerate(zip(self.files, self.folders, strict=True), start=1):
                place = "" if self.single else f"{number} of {count}"
                with self.command.working(f"{doing} {file} {place}"):
                    outcome = next(outcomes)
                rows.append(outcome.row)
                faults += outcome.faults
                refused |= outcome.refused
                if not self.single:
                    self.command.say(f"{place}  {outcome.words}")
                elif outcome.show is not None:
                    outcome.show()
                    self.command.say(names_written(folder, names))
                if document and not outcome.faults:
                    self.command.record(folder / document)
        finally:
            # The summary of an interrupted command has the rows of the finished files.
            if not self.single:
                write_summary(self.out / SUMMARY, rows, columns)
        if not self.single:
            self.command.say(f"written: {self.out}/: {SUMMARY}, a folder for each file")
        last(rows)
        if faults:
            raise InputError(faults)
        return NOT_USABLE if refused else 0
