"""Clocks of joined files: the time from one file to the next.

It is determined by the first available of: a pause that the user states; the dates at which both clocks were zero (comment
`time_zero` of captures); times that continue from file to file. Otherwise the pause is an unknown positive time: each part
then has a separate clock, and drift is not evaluated across the pause (`effects.drift`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from jaxtyping import Float

from tumblecal.data.cells import number_in
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


def joined_clocks(sets: Sequence[PositionSet], pauses: Sequence[str] = ()) -> JoinedClocks | None:
    """The times of consecutive files; None if not all have times.

    **Arguments:**

    - `pauses`: the pause before each later file, or one for all: a time with its unit, `unknown`, or `none` for one clock.
      Default: from the files.

    **Raises:** `InputError` for a wrong number or form of pauses, and for an invalid date.
    """
    stated = _stated(pauses, len(sets) - 1)
    if lacking := ", ".join(given.source for given in sets if given.time_s is None):
        if pauses:
            raise InputError(f"--pause: {lacking} has no column time_s, so a pause has no influence; remove the option")
        return None
    # Times on the clock of the recording, if all files state it.
    began = [number_in(given.comments.get(TIME_BEGAN))[0] for given in sets]
    began = began if np.isfinite(began).all() else [0.0] * len(sets)
    times = [np.asarray(given.time_s, float) + first - began[0] for given, first in zip(sets, began, strict=True)]
    zeros = [_time_zero(given) for given in sets]
    # Offset of each file, and the number of its clock.
    offsets, clocks, words = [0.0], [0], list[str]()
    for k, pause in enumerate(stated, start=1):
        last = float(times[k - 1].max()) + offsets[-1]
        offset, how = _offset(
            last, times[k], offsets[-1], pause, _zero_offset(zeros[k - 1 : k + 1], offsets[-1], sets[k])
        )
        gap = None if offset is None else float(times[k].min()) + offset - last
        words.append(_in_words(sets[k - 1], sets[k], gap, how))
        offsets.append(0.0 if offset is None else offset)
        clocks.append(clocks[-1] + (offset is None))
    moved = [one + offset for one, offset in zip(times, offsets, strict=True)]
    parts = [[one for one, clock in zip(moved, clocks, strict=True) if clock == k] for k in range(clocks[-1] + 1)]
    rows = [(k, label) for k, given in zip(clocks, sets, strict=True) for label in given.clock or ("",) * len(given)]
    numbers = {row: str(number) for number, row in enumerate(dict.fromkeys(rows), start=1)}
    clock_of_rows = tuple(numbers[row] for row in rows) if len(numbers) > 1 else None
    return JoinedClocks(continued_times([np.concatenate(part) for part in parts]), clock_of_rows, tuple(words))


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


def _offset(
    last: float, times: np.ndarray, offset: float, pause: float | str | None, zero: float | None
) -> tuple[float | None, str]:
    """What is added to the times of a file on the clock of the previous file, and the source of this; None if it is unknown.

    **Arguments:**

    - `last`: end of the previous file, on its clock, and `offset`: its offset. `times`: of this file, as written.
    - `zero`: time zero of this file on that clock, from the dates of both.
    """
    if pause is not None:
        known = {UNKNOWN_PAUSE: None, ONE_CLOCK: offset}
        return known[pause] if isinstance(pause, str) else last + pause - float(times.min()), "stated"
    if zero is not None:
        return zero, f"comment {TIME_ZERO}"
    gap = float(times.min()) + offset - last
    return (offset, "time_s continues") if 0.0 < gap <= _LONGEST_PAUSE_S else (None, "")


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


def _zero_offset(zeros: Sequence[datetime | None], offset: float, given: PositionSet) -> float | None:
    """Time zero of a file on the clock of the previous one, by the dates of both (`zeros`)."""
    before, after = zeros
    if before is None or after is None:
        return None
    text = given.comments.get(TIME_SPEED, "1")
    speed, wrong = number_in(text)
    if wrong:
        raise InputError(f"{given.source}: comment {TIME_SPEED}: {text!r} is not a number; delete the line")
    return offset + (after - before).total_seconds() * speed


def _in_words(before: PositionSet, after: PositionSet, gap: float | None, how: str) -> str:
    first, second = (Path(given.source).name for given in (before, after))
    if first == second:
        first, second = before.source, after.source
    if gap is None:
        why = "as stated" if how else "its clock restarts"
        return (
            f"Pause between {first} and {second}: unknown ({why}). Changes over it are fitted, so no drift depends on its "
            "length. If it is known, give for example --pause '2 h'."
        )
    if gap < 0:
        return f"{second} begins {duration(-gap)} before the end of {first} ({how}; --pause unknown if that is wrong)."
    override = "" if how == "stated" else "; --pause unknown if each file has a separate clock"
    return f"Pause between {first} and {second}: {duration(gap)} ({how}{override})."
