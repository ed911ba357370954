"""How the clocks of files that are joined go on from one to the next.

By the first of these that decides: a pause that the user states; the moments at which both clocks were zero (comment
`time_zero`, which captures write); times that go on from file to file. Otherwise the pause is an unknown positive time: the
positions then have a clock for each part, and no drift is judged across (`effects.drift`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from tumblecal.data.positions import PositionSet
from tumblecal.ground.clocks import times_going_on
from tumblecal.ground.errors import InputError
from tumblecal.ground.units import quantity


# Comments: the moment (ISO 8601) at which time_s was zero, and by how much time_s runs faster than that clock (emulators do).
TIME_ZERO, TIME_SPEED = "time_zero", "time_speed"
# Comment: what a recording's own clock showed when time_s was zero, s.
TIME_BEGAN = "time_began_s"
# Words that --pause accepts in place of a time.
UNKNOWN_PAUSE, ONE_CLOCK = "unknown", "none"
# Times that go on over a longer gap are those of clocks that were set differently, s.
_LONGEST_PAUSE_S = 366 * 86400.0


@dataclass(frozen=True)
class JoinedClocks:
    """The times of joined files.

    - `time_s`: of all rows, increasing from file to file; `clock`: each row's clock, None where one counts for all.
    - `words`: how each file follows the one before it, a sentence each.
    """

    time_s: Float[np.ndarray, " rows"]
    clock: tuple[str, ...] | None
    words: tuple[str, ...]


@dataclass
class _Part:
    """Files by one clock: each one's times on it."""

    times: list[Float[np.ndarray, " rows"]]
    labels: list[tuple[str, ...] | None]


def joined_clocks(sets: Sequence[PositionSet], pauses: Sequence[str] = ()) -> JoinedClocks | None:
    """The times of files that follow one another; None where not all have times.

    **Arguments:**

    - `pauses`: the pause before each file after the first, or one for all: a time with its unit, `unknown`, or `none` for
      times by one clock. By the files themselves where left out.

    **Raises:** `InputError` for pauses of another number or form, and a moment that is no date and time.
    """
    stated = _stated(pauses, len(sets) - 1)
    if any(given.time_s is None for given in sets):
        if pauses:
            lacking = ", ".join(given.source for given in sets if given.time_s is None)
            raise InputError(f"--pause: {lacking} has no column time_s, so that no pause matters; leave the option out")
        return None
    zeros, began = [_time_zero(given) for given in sets], _began(sets)
    times = [np.asarray(given.time_s, float) + first for given, first in zip(sets, began, strict=True)]
    parts, words, offset = [_Part([times[0]], [sets[0].clock])], [], 0.0
    rows = zip(pairwise(sets), pairwise(times), stated, pairwise(zeros), strict=True)
    for (before, after), (last, own), pause, (zero_before, zero) in rows:
        last = last + offset
        moved, how = _follows(last, own, offset, pause, _apart(zero_before, zero, offset, after))
        words.append(_in_words(before, after, moved, last, how))
        if moved is None:
            offset = 0.0
            parts.append(_Part([own], [after.clock]))
        else:
            offset = float(moved[0] - own[0])
            parts[-1].times.append(moved)
            parts[-1].labels.append(after.clock)
    time = times_going_on([np.concatenate(part.times) for part in parts])
    own_clocks = [
        (number, label)
        for number, part in enumerate(parts)
        for times, labels in zip(part.times, part.labels, strict=True)
        for label in labels or ("",) * len(times)
    ]
    clocks = {clock: str(number) for number, clock in enumerate(dict.fromkeys(own_clocks), start=1)}
    clock = tuple(clocks[own] for own in own_clocks) if len(clocks) > 1 else None
    return JoinedClocks(time, clock, tuple(words))


def _began(sets: Sequence[PositionSet]) -> list[float]:
    """What each recording's clock showed at time zero of the file, s, less the first one's; zero unless all state it."""
    try:
        listed = [float(given.comments[TIME_BEGAN]) for given in sets]
    except (KeyError, ValueError):
        return [0.0] * len(sets)
    return [began - listed[0] for began in listed]


def _stated(pauses: Sequence[str], boundaries: int) -> list[float | str | None]:
    """The pause before each later file: s, or a word; None where it is not stated."""
    if len(pauses) not in (0, 1, boundaries):
        raise InputError(
            f"--pause is given {len(pauses)} times for {boundaries} pauses between the files; give one for all, or one each"
        )
    read: list[float | str | None] = []
    for text in pauses:
        if text in (UNKNOWN_PAUSE, ONE_CLOCK):
            read.append(text)
            continue
        try:
            seconds = quantity(text, "s")
        except InputError as fault:
            raise InputError(f"--pause {fault}; or {UNKNOWN_PAUSE}, or {ONE_CLOCK} (one clock for all files)") from None
        if seconds < 0:
            raise InputError(f"--pause {text}: must not be below 0")
        read.append(seconds)
    return read * boundaries if len(read) == 1 else read or [None] * boundaries


def _follows(
    last: np.ndarray, own: np.ndarray, offset: float, pause: float | str | None, apart: float | None
) -> tuple[np.ndarray | None, str]:
    """A file's times on the clock of the one before it, and how that is known; None where it is not.

    **Arguments:**

    - `last`: times of the file before, on its clock. `own`: of this file, as written. `offset`: of the file before.
    - `apart`: this file's zero on that clock, by the moments that both state.
    """
    if pause == UNKNOWN_PAUSE:
        return None, "stated"
    if isinstance(pause, float):
        return own - own.min() + last.max() + pause, "stated"
    if pause == ONE_CLOCK:
        return own + offset, "stated"
    if apart is not None:
        return own + apart, f"comment {TIME_ZERO}"
    going_on = own + offset
    gap = float(going_on.min() - last.max())
    return (going_on, "time_s goes on") if 0.0 < gap <= _LONGEST_PAUSE_S else (None, "")


def moment(seconds: float) -> str:
    """A time since 1970, s, as the comment `time_zero` holds it."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _time_zero(given: PositionSet) -> datetime | None:
    """When a file's times were zero, by its comment."""
    text = given.comments.get(TIME_ZERO)
    if text is None:
        return None
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise InputError(
            f"{given.source}: comment {TIME_ZERO}: {text!r} is no date and time; write it like 2026-03-14T09:26:53Z, or "
            "delete the line"
        ) from None
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment


def _apart(before: datetime | None, after: datetime | None, offset: float, given: PositionSet) -> float | None:
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
        why = "as stated" if how else "its clock starts again"
        return (
            f"Pause between {first} and {second}: unknown ({why}); changes over it are fitted, so no drift depends on its "
            "length. If it is known: --pause '2 h'."
        )
    gap = float(moved.min() - last.max())
    if gap < 0:
        return f"{second} begins {_duration(-gap)} before the end of {first} ({how}; --pause unknown if that is wrong)."
    override = "" if how == "stated" else "; --pause unknown if each file has a clock of its own"
    return f"Pause between {first} and {second}: {_duration(gap)} ({how}{override})."


def _duration(seconds: float) -> str:
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
