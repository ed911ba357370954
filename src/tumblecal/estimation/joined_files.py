"""Position files that are joined into one measurement: their runs, mountings and clocks."""

from collections.abc import Sequence

from tumblecal.chain.rig import Rig
from tumblecal.data import PositionSet
from tumblecal.data.joined import joined, with_separate_runs
from tumblecal.data.joined_clocks import joined_clocks
from tumblecal.estimation.mountings import with_distinct_mounts
from tumblecal.estimation.planned_positions import indexed_by_visit
from tumblecal.ground.errors import InputError


def joined_files(
    parts: Sequence[PositionSet], rig: Rig | None, pauses: Sequence[str] = (), *, same_run: bool = False
) -> tuple[PositionSet, list[str]]:
    """The positions of all files, and words on runs and pauses.

    **Arguments:**

    - `pauses`: as of `joined_clocks`. `same_run`: whether all files without a column run are one run.

    **Raises:** `InputError` for files that do not belong together.
    """
    serials = {part.serial_number: part.source for part in parts if part.serial_number}
    if len(serials) > 1:
        listed = ", ".join(f"{source} {serial}" for serial, source in serials.items())
        raise InputError(f"--join: serial numbers differ ({listed}); join the files of one unit only")
    planned = indexed_by_visit(rig)
    parts = list(parts) if rig else with_distinct_mounts(parts)
    parts = parts if same_run or planned else with_separate_runs(parts)
    clocks = joined_clocks(parts, pauses)
    whole, words = joined(parts, clocks), [*(clocks.words if clocks else ())]
    if len(parts) < 2 or (whole.run is None and (whole.mount is not None or planned)):
        return whole, words  # each file has its own mounting, or all are those of a designed plan
    if whole.run is None:
        return whole, [f"Assumed: one run for all {len(parts)} files.", *words]
    runs = ", ".join(dict.fromkeys(whole.run))
    return whole, [f"Runs: {runs}. With --same-run, all files without a column run are one run.", *words]
