"""Numbers of things in words."""


def counted(number: int, word: str) -> str:
    """`1 row`, `2 rows`, `2 stretches`."""
    ending = "es" if word.endswith("ch") else "s"
    return f"{number} {word}{'' if number == 1 else ending}"
