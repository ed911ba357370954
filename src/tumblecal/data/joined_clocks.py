"""Clocks of joined files: the time from one file to the next.

It is determined by the first available of: a pause that the user states; the dates at which both clocks were zero (comment
`time_zero` of captures); times that continue from file to file. Otherwise the pause is an unknown positive time: each part
then has a separate clock, and drift is not evaluated across the pause (`effects.drift`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from tumblecal.data.positions import PositionSet
from tumblecal.ground.clocks import continued_times
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import duration
from tumblecal.ground.option_texts import size


# Comments: the date (ISO 8601) at which time_s was zero, and the rate of time_s relative to that clock (for emulators).
TIME_ZERO, TIME_SPEED = "time_zero", "time_speed"
# Comment: the clock of the recording when time_s was zero, s.
TIME_BEGAN = "time_began_s"
# Values of --pause that are not times.
UNKNOWN_PAUSE, ONE_CLOCK = "unknown", "none"
# Longest gap of times on one clock, s; a longer one is due to different settings of the clocks.
_LONGEST_PAUSE_S = 366 * 86400.0


@dataclass(frozen=True)
class JoinedClocks:
    """The times of joined files.

    - `time_s`: of all rows, increasing from file to file; `clock`: label of the clock of each row, None for one clock.
    - `words`: a sentence on the pause before each later file.
    """

    time_s: Float[np.ndarray, " rows"]
    clock: tuple[str, ...] | None
    words: tuple[str, ...]


@dataclass
class _Part:
    """Files with one clock, and their times."""

    times: list[Float[np.ndarray, " rows"]]
    labels: list[tuple[str, ...] | None]


def joined_clocks(sets: Sequence[PositionSet], pauses: Sequence[str] = ()) -> JoinedClocks | None:
    """The times of consecutive files; None if not all have times.

    **Arguments:**

    - `pauses`: the pause before each later file, or one for all: a time with its unit, `unknown`, or `none` for one clock.
      Default: from the files.

    **Raises:** `InputError` for a wrong number or form of pauses, and for an invalid date.
    """
    stated = _stated(pauses, len(sets) - 1)
    if any(given.time_s is None for given in sets):
        if pauses:
            lacking = ", ".join(given.source for given in sets if given.time_s is None)
            raise InputError(f"--pause: {lacking} has no column time_s, so a pause has no influence; remove the option")
        return None
    zeros, began = [_time_zero(given) for given in sets], _began(sets)
    times = [np.asarray(given.time_s, float) + first for given, first in zip(sets, began, strict=True)]
    parts, words, offset = [_Part([times[0]], [sets[0].clock])], [], 0.0
    rows = zip(pairwise(sets), pairwise(times), stated, pairwise(zeros), strict=True)
    for (before, after), (last, times_of_file), pause, (zero_before, zero) in rows:
        last = last + offset
        moved, how = _follows(last, times_of_file, offset, pause, _zero_offset(zero_before, zero, offset, after))
        words.append(_in_words(before, after, moved, last, how))
        if moved is None:
            offset = 0.0
            parts.append(_Part([times_of_file], [after.clock]))
        else:
            offset = float(moved[0] - times_of_file[0])
            parts[-1].times.append(moved)
            parts[-1].labels.append(after.clock)
    time = continued_times([np.concatenate(part.times) for part in parts])
    clock_of_rows = [
        (number, label)
        for number, part in enumerate(parts)
        for times, labels in zip(part.times, part.labels, strict=True)
        for label in labels or ("",) * len(times)
    ]
    clocks = {clock: str(number) for number, clock in enumerate(dict.fromkeys(clock_of_rows), start=1)}
    clock = tuple(clocks[label] for label in clock_of_rows) if len(clocks) > 1 else None
    return JoinedClocks(time, clock, tuple(words))


def _began(sets: Sequence[PositionSet]) -> list[float]:
    """The clock of each recording at time zero of its file, s, minus that of the first; zero unless all state it."""
    try:
        listed = [float(given.comments[TIME_BEGAN]) for given in sets]
    except (KeyError, ValueError):
        return [0.0] * len(sets)
    return [began - listed[0] for began in listed]


def _stated(pauses: Sequence[str], boundaries: int) -> list[float | str | None]:
    """The pause before each later file: s, or a word; None if not stated."""
    if len(pauses) not in (0, 1, boundaries):
        raise InputError(
            f"--pause is given {len(pauses)} times for {boundaries} pauses between files; give one for all, or one for each"
        )
    read: list[float | str | None] = []
    for text in pauses:
        word = text in (UNKNOWN_PAUSE, ONE_CLOCK)
        read.append(text if word else size(f"--pause (a time, {UNKNOWN_PAUSE} or {ONE_CLOCK})", text, "s", zero=True))
    return read * boundaries if len(read) == 1 else read or [None] * boundaries


def _follows(
    last: np.ndarray, times: np.ndarray, offset: float, pause: float | str | None, zero: float | None
) -> tuple[np.ndarray | None, str]:
    """Times of a file on the clock of the previous file, and the source of this; None if it is unknown.

    **Arguments:**

    - `last`: times of the previous file, on its clock. `times`: of this file, as written. `offset`: of the previous file.
    - `zero`: time zero of this file on that clock, from the dates of both.
    """
    if pause == UNKNOWN_PAUSE:
        return None, "stated"
    if isinstance(pause, float):
        return times - times.min() + last.max() + pause, "stated"
    if pause == ONE_CLOCK:
        return times + offset, "stated"
    if zero is not None:
        return times + zero, f"comment {TIME_ZERO}"
    continued = times + offset
    gap = float(continued.min() - last.max())
    return (continued, "time_s continues") if 0.0 < gap <= _LONGEST_PAUSE_S else (None, "")


def moment(seconds: float) -> str:
    """A time since 1970, s, in the form of the comment `time_zero`."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _time_zero(given: PositionSet) -> datetime | None:
    """The date of time zero of a file, from its comment."""
    text = given.comments.get(TIME_ZERO)
    if text is None:
        return None
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise InputError(
            f"{given.source}: comment {TIME_ZERO}: {text!r} is not a date and time; write it as 2026-03-14T09:26:53Z, "
            "or delete the line"
        ) from None
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment


def _zero_offset(before: datetime | None, after: datetime | None, offset: float, given: PositionSet) -> float | None:
    if before is None or after is None:
        return None
    text = given.comments.get(TIME_SPEED, "1")
    try:
        speed = float(text)
    except ValueError:
        raise InputError(f"{given.source}: comment {TIME_SPEED}: {text!r} is not a number; delete the line") from None
    return offset + (after - before).total_seconds() * speed


def _in_words(before: PositionSet, after: PositionSet, moved: np.ndarray | None, last: np.ndarray, how: str) -> str:
    first, second = (Path(given.source).name for given in (before, after))
    if first == second:
        first, second = before.source, after.source
    if moved is None:
        why = "as stated" if how else "its clock restarts"
        return (
            f"Pause between {first} and {second}: unknown ({why}). Changes over it are fitted, so no drift depends on its "
            "length. If it is known, give for example --pause '2 h'."
        )
    gap = float(moved.min() - last.max())
    if gap < 0:
        return f"{second} begins {duration(-gap)} before the end of {first} ({how}; --pause unknown if that is wrong)."
    override = "" if how == "stated" else "; --pause unknown if each file has a separate clock"
    return f"Pause between {first} and {second}: {duration(gap)} ({how}{override})."
