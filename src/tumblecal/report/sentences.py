"""Words that begin a sentence."""


def as_sentence(words: str) -> str:
    """Words with a capital letter first; names and symbols in them stay as they are."""
    return words[:1].upper() + words[1:]
