"""Numbers of things, and long lists, in words."""

from collections.abc import Sequence


def counted(number: int, word: str) -> str:
    """`1 row`, `2 rows`, `2 stretches`."""
    ending = "es" if word.endswith("ch") else "s"
    return f"{number} {word}{'' if number == 1 else ending}"


def shortened(words: Sequence[str], most: int, joint: str = ", ", last: str = " and") -> str:
    """The first `most` words joined: `a, b`, or `a, b and 3 more`."""
    more = len(words) - most
    return joint.join(words[:most]) + (f"{last} {more} more" if more > 0 else "")
