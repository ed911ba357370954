"""How far a run's instrument was confirmed, for the results: the serial number of unconfirmed data is not written as theirs."""

from collections.abc import Sequence
from typing import Any

from tumblecal.capture.journal import Attempt, Standing
from tumblecal.data.positions import NOT_CONFIRMED


def unconfirmed(standing: Standing, attempts: Sequence[Attempt]) -> list[int]:
    """Which of the accepted attempts were recorded with an instrument whose serial number was not stated, by place."""
    since = min((entry["wall_ns"] for entry in standing.doubts), default=None)
    if standing.serial_number is not None:
        return [place for place, attempt in enumerate(attempts) if attempt.serial_number is None]
    # An instrument that never states one: those after the line was interrupted.
    return [place for place, attempt in enumerate(attempts) if since is not None and attempt.wall_ns > since]


def identity_comments(standing: Standing, attempts: Sequence[Attempt], names: Sequence[str]) -> dict[str, str]:
    """Comments of a file of position means."""
    serial, places = standing.serial_number, unconfirmed(standing, attempts)
    if not places:
        return {"serial_number": str(serial)} if serial else {}
    which = ", ".join(names[place] for place in places)
    found = "; ".join(entry["text"] for entry in standing.doubts if "text" in entry) or "no serial number stated"
    comments = {NOT_CONFIRMED: f"position {which}: {found}"}
    return comments | ({"serial_number_not_confirmed": str(serial)} if serial else {})


def identity_content(standing: Standing, attempts: Sequence[Attempt], names: Sequence[str]) -> dict[str, Any]:
    """The same for reduction.json."""
    places = unconfirmed(standing, attempts)
    return {
        "confirmed": not places and standing.serial_number is not None,
        "serial_number": standing.serial_number,
        "positions_not_confirmed": [names[place] for place in places],
        "entries": standing.doubts,
    }
