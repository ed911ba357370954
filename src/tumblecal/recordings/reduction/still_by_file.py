"""The intervals at rest of several files of one recording, file by file."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import Criterion
from tumblecal.recordings.reduction.file_stream import FilePart
from tumblecal.recordings.still.stillness import Interval, Stillness


# Intervals of a file whose attitude differs by more than this from its longest one are of a different position, deg.
_OTHER_ATTITUDE_DEG = 10.0


def _length_s(part: FilePart) -> float:
    return (part.stop - part.start) / (part.contents.rate_hz or np.inf)


def check_lengths(parts: Sequence[FilePart], criterion: Criterion) -> None:
    """Check that a file is long enough for an interval at rest.

    **Raises:** `InputError` if all files are too short.
    """
    longest = max(parts, key=_length_s)
    if _length_s(longest) < criterion.least_s:
        raise InputError(
            f"{longest.file}: the longest of {len(parts)} files lasts {_length_s(longest):.2g} s; an interval at rest needs "
            f"{criterion.least_s:.2g} s: lower --least-s {criterion.least_s:g}"
        )


def part_of(interval: Interval, parts: Sequence[FilePart]) -> int:
    """The number of an interval's part."""
    middle = (interval.start + interval.stop) // 2
    return next(k for k, part in enumerate(parts) if middle < part.stop)


def within_files(stillness: Stillness, parts: Sequence[FilePart]) -> Stillness:
    """The intervals without rows of the file before or after, which a block at the boundary may include."""
    cut = []
    for interval in stillness.intervals:
        part = parts[part_of(interval, parts)]
        cut.append(replace(interval, start=max(interval.start, part.start), stop=min(interval.stop, part.stop)))
    return replace(stillness, intervals=cut)


def one_attitude_each(stillness: Stillness, parts: Sequence[FilePart]) -> Stillness:
    """The longest interval of each file, and those with its attitude, since a file has one position."""
    reasons = {}
    for number, part in enumerate(parts):
        of_file = [interval for interval in stillness.used if part_of(interval, parts) == number]
        longest = max(of_file, key=lambda interval: interval.stop - interval.start, default=None)
        for interval in of_file:
            assert longest is not None
            cosine = interval.mean @ longest.mean / np.linalg.norm(interval.mean) / np.linalg.norm(longest.mean)
            angle = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
            if angle > _OTHER_ATTITUDE_DEG:
                reasons[interval.start] = (
                    f"attitude: {angle:.0f} deg from the longest interval at rest of {part.file.name}"
                )
    return stillness.rejecting(reasons)


def without_still(stillness: Stillness, parts: Sequence[FilePart]) -> list[tuple[str, str]]:
    """A line for each file without an interval at rest."""
    having = {part_of(interval, parts) for interval in stillness.used}
    lines = []
    for number, part in enumerate(parts):
        if number not in having:
            of_file = [interval for interval in stillness.intervals if part_of(interval, parts) == number]
            longest = max(of_file, key=lambda interval: interval.stop - interval.start, default=None)
            reason = longest.reason if longest else f"all of its {_length_s(part):.2g} s move"
            line = f"no interval at rest ({reason}), so its position is missing; reduce --least-s, or record it again"
            lines.append((str(part.file), line))
    return lines
