"""Whether the instrument of a file of positions is known to be one and the same, in words."""

from tumblecal.data.positions import NOT_CONFIRMED, PositionSet


def identity_words(data: PositionSet) -> str:
    """The positions at which the instrument did not state its serial number, and the result of a comparison; "" if none."""
    words = data.comments.get(NOT_CONFIRMED, "")
    return f"Identity of the instrument not confirmed: {words}" if words else ""
