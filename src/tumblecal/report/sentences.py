"""Words as sentences, and commands at their ends."""

import re


# A command to be pasted ends a text: it is not folded, and no full stop follows it.
_COMMAND = re.compile(r"(.*: )(tumblecal \S.*)", re.DOTALL)


def command_at_end(words: str) -> tuple[str, str]:
    """Words without the command that ends them, and the command; "" where none does."""
    match = _COMMAND.fullmatch(words)
    return (match[1].rstrip(), match[2]) if match else (words, "")


def ended(words: str) -> str:
    """Words with a full stop, unless a command ends them."""
    return words if command_at_end(words)[1] else f"{words}."


def as_sentence(words: str) -> str:
    """Words with a capital letter first, unless they begin with a name of a parameter or effect."""
    return words if "_" in words.partition(" ")[0] else words[:1].upper() + words[1:]
