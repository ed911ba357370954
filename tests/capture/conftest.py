"""Tables read in small pieces."""

import pytest

from tumblecal.capture import corrected_text
from tumblecal.data import raw


@pytest.fixture
def small_pieces(monkeypatch):
    """Pieces of three rows; of text that is written, of some forty bytes."""

    def pieces(table, rows):
        whole = table.collect()
        return (whole[k : k + 3] for k in range(0, len(whole), 3))

    monkeypatch.setattr(raw, "pieces_in_order", pieces)
    monkeypatch.setattr(corrected_text, "_PIECE", 40)
