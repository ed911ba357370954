"""When something was measured, as the comment `measured_utc` states it."""

from datetime import datetime

from tumblecal.ground.errors import InputError


MEASURED = "measured_utc"


def measured_at(stated: str, named: str) -> datetime:
    """The date of a text such as 2026-03-31T10:30:00Z.

    **Raises:** `InputError` that begins with `named` for a text that is no date.
    """
    try:
        return datetime.fromisoformat(stated)
    except ValueError as error:
        raise InputError(f"{named}: {stated!r} is no date; write 2026-03-31 or 2026-03-31T10:30:00Z") from error
