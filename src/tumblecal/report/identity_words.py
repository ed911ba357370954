"""Whether the instrument of a file of positions is known to be one and the same, in words."""

from tumblecal.data.positions import NOT_CONFIRMED, PositionSet


def identity_words(data: PositionSet) -> str:
    """That the instrument did not state its serial number at some positions, and what a comparison found; "" otherwise."""
    said = data.comments.get(NOT_CONFIRMED, "")
    return f"Identity of the instrument not confirmed: {said}" if said else ""
