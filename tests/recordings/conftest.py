"""Tables read in small pieces."""

import pytest

from tumblecal.data import parquet, text_cells


@pytest.fixture
def small_pieces(monkeypatch):
    """Pieces of three rows; of text, of 400 bytes."""

    def pieces(table, rows=0):
        whole = table.collect()
        return (whole[k : k + 3] for k in range(0, len(whole), 3))

    monkeypatch.setattr(parquet, "pieces_in_order", pieces)
    monkeypatch.setattr(text_cells, "_PIECE", 400)
