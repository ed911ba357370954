"""What a user should know of position means as they were read: unused columns, copied rows, and rows that are raw samples."""

from pathlib import Path

from tumblecal.data.positions import PositionSet
from tumblecal.data.repeats import copied_positions
from tumblecal.data.table import KNOWN, READINGS, likely_meant
from tumblecal.ground.counted import counted, shortened
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import suggested


_MOST_COPIES = 3
# This many consecutive rows of one name and setting are samples of one dwell.
_LIKE_SAMPLES = 16


def position_notes(data: PositionSet) -> list[str]:
    """Columns that may have been meant, and rows that look copied, as warnings.

    **Raises:** `InputError` for raw samples.
    """
    if len(data) >= _LIKE_SAMPLES * data.stretches:
        reduced = Path("reduced")
        raise InputError(
            f"{data.source}: {len(data)} rows, but only {counted(data.stretches, 'stretch')} of one position each, so these "
            f"look like raw samples. Reduce them first, then give {reduced / 'positions.csv'}: "
            f"{suggested('reduce', data.source, '--out', reduced)}"
        )
    free = [name for name in KNOWN if name not in (*data.columns, *READINGS)]
    meant = {name: likely_meant(name, free) for name in data.ignored}
    notes = [
        f"column {name} is not used; did you mean {other}? Rename it, or give --columns {other}={name}"
        for name, other in meant.items()
        if other
    ]
    if copies := [f"{name} and {first}" for name, first in copied_positions(data)]:
        listed = shortened(copies, _MOST_COPIES)
        notes.append(f"identical rows: positions {listed}; a copied row is weighted twice: remove it")
    return notes
