"""Confirmation of a run's instrument, for the results: unconfirmed data are written without a serial number."""

from collections.abc import Sequence
from typing import Any

from tumblecal.capture.journal import Attempt, RunState
from tumblecal.data.positions import NOT_CONFIRMED


def unconfirmed(state: RunState, attempts: Sequence[Attempt]) -> list[int]:
    """Places of the accepted attempts whose instrument did not state its serial number."""
    since = min((entry["wall_ns"] for entry in state.doubts), default=None)
    if state.serial_number is not None:
        return [place for place, attempt in enumerate(attempts) if attempt.serial_number is None]
    # If the instrument never states one: the attempts after an interruption of the line.
    return [place for place, attempt in enumerate(attempts) if since is not None and attempt.wall_ns > since]


def identity_comments(state: RunState, attempts: Sequence[Attempt], names: Sequence[str]) -> dict[str, str]:
    """Comments of a file of position means."""
    serial, places = state.serial_number, unconfirmed(state, attempts)
    if not places:
        return {"serial_number": str(serial)} if serial else {}
    which = ", ".join(names[place] for place in places)
    found = "; ".join(entry["text"] for entry in state.doubts if "text" in entry) or "no serial number stated"
    comments = {NOT_CONFIRMED: f"position {which}: {found}"}
    return comments | ({"serial_number_not_confirmed": str(serial)} if serial else {})


def identity_content(state: RunState, attempts: Sequence[Attempt], names: Sequence[str]) -> dict[str, Any]:
    """The same for reduction.json."""
    places = unconfirmed(state, attempts)
    return {
        "confirmed": not places and state.serial_number is not None,
        "serial_number": state.serial_number,
        "positions_not_confirmed": [names[place] for place in places],
        "entries": state.doubts,
    }
