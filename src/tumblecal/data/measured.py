"""Date of a measurement, from the comment `measured_utc`."""

from datetime import datetime

from tumblecal.ground.errors import InputError


MEASURED = "measured_utc"


def measured_at(stated: str, named: str) -> datetime:
    """The date of a text such as 2026-03-31T10:30:00Z.

    **Raises:** `InputError`, with `named` first, for a text that is not a date.
    """
    try:
        return datetime.fromisoformat(stated)
    except ValueError as error:
        raise InputError(f"{named}: {stated!r} is not a date; write 2026-03-31 or 2026-03-31T10:30:00Z") from error
