"""Numbers of things, durations, and long lists, in words."""

from collections.abc import Sequence


def counted(number: int, word: str) -> str:
    """`1 row`, `2 rows`, `2 stretches`."""
    ending = "es" if word.endswith("ch") else "s"
    return f"{number} {word}{'' if number == 1 else ending}"


def duration(seconds: float) -> str:
    """`90 s`, `5 min`, `2.5 h`, `3 d`."""
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def shortened(words: Sequence[str], most: int, joint: str = ", ", last: str = " and") -> str:
    """The first `most` words joined: `a, b`, or `a, b and 3 more`."""
    more = len(words) - most
    return joint.join(words[:most]) + (f"{last} {more} more" if more > 0 else "")
