"""Several files as one measurement: the options of calibrate and diagnose, and the joined positions."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.chain.rig import Rig
    from tumblecal.data import PositionSet


# Printed for joined files without a column mount, if something was found.
ONE_MOUNTING = (
    "Assumed: one mounting for all files. If the triad was removed from its fixture between them, add a column mount "
    "(such as A and B)."
)


@Parameter(name="*")
@dataclass(frozen=True)
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
    same_run: Annotated[bool, Parameter(negative=())] = False
    pause: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()

    def check(self) -> None:
        """Check that --join is given with the options that need it.

        **Raises:** `InputError` with the option.
        """
        if self.same_run and not self.join:
            raise InputError("--same-run applies to joined files only; add --join")
        if self.pause and not self.join:
            raise InputError("--pause is the time between joined files; add --join")

    def joined(self, parts: "Sequence[PositionSet]", rig: "Rig | None") -> "tuple[PositionSet, str]":
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
        parts = list(parts) if rig else with_distinct_mounts(parts)
        parts = parts if self.same_run or indexed_by_visit(rig) else with_separate_runs(parts)
        clocks = joined_clocks(parts, self.pause)
        whole = joined(parts, clocks)
        runs = _runs_in_words(parts, whole, planned=indexed_by_visit(rig))
        return whole, "\n".join(filter(None, [runs, *(clocks.words if clocks else ())]))


def _runs_in_words(parts: "Sequence[PositionSet]", whole: "PositionSet", *, planned: bool) -> str:
    """The runs of joined files; empty if each file has its own mounting, or if all are those of a designed plan."""
    if len(parts) < 2 or (whole.run is None and (whole.mount is not None or planned)):
        return ""
    if whole.run is None:
        return f"Assumed: one run for all {len(parts)} files."
    runs = list(dict.fromkeys(whole.run))
    run_of_each_file = len(runs) == len(parts) and all(len(set(part.run or ())) == 1 for part in parts)
    source = "one for each file (--same-run joins them)" if run_of_each_file else "from the columns run"
    return f"Runs: {', '.join(runs)}: {source}."
