"""Comments of a position file, `# key: value`, by their keys."""

from collections.abc import Mapping
from datetime import datetime
from typing import TYPE_CHECKING

from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.data.positions import PositionSet


# The comment `# attitudes: ...` states how the attitudes were set: by a head at the angles of the file, by hand near these
# angles, or not known (a hand-held set).
ATTITUDES, BY_HEAD, BY_HAND, UNKNOWN = "attitudes", "head", "hand", "unknown"
# The comment with the date of the measurement, and that with the noise of the recording.
MEASURED, NOISE_MODEL = "measured_utc", "noise_model"
# The comment on positions of an instrument that did not transmit its serial number.
NOT_CONFIRMED = "identity_not_confirmed"
# The comment on changes within dwells; with the suffix `_temperature_mg` or `_time_mg` the largest change with that variable.
WITHIN_DWELLS = "within_dwells"


def serial_number_of(comments: Mapping[str, str]) -> str | None:
    """The serial number in the comments of a file; None without one, and for "None" (captures of devices without one)."""
    serial = comments.get("serial_number")
    return None if serial in (None, "", "None") else serial


def identity_words(data: "PositionSet") -> str:
    """The positions at which the instrument did not state its serial number, and the result of a comparison; "" if none."""
    words = data.comments.get(NOT_CONFIRMED, "")
    return f"Identity of the instrument not confirmed: {words}" if words else ""


def measured_at(stated: str, named: str) -> datetime:
    """The date of a text such as 2026-03-31T10:30:00Z.

    **Raises:** `InputError`, with `named` first, for a text that is not a date.
    """
    try:
        return datetime.fromisoformat(stated)
    except ValueError as error:
        raise InputError(f"{named}: {stated!r} is not a date; write 2026-03-31 or 2026-03-31T10:30:00Z") from error
