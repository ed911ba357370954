"""Tables read in small pieces; plans."""

import pytest
from recordings_made import ANGLES

from snapshot_texts import snapshot as snapshot
from tumblecal.data import parquet, text_cells


@pytest.fixture
def small_pieces(monkeypatch):
    """Pieces of three rows; of text, of 400 bytes."""

    def pieces(table, rows=0):
        whole = table.collect()
        return (whole[k : k + 3] for k in range(0, len(whole), 3))

    monkeypatch.setattr(parquet, "pieces_in_order", pieces)
    monkeypatch.setattr(text_cells, "_PIECE", 400)


@pytest.fixture
def six(tmp_path):
    """A plan of six faces with names."""
    rows = [f'{{name = "{name}", alpha_deg = {a}, beta_deg = {b}}}' for name, (a, b) in ANGLES.items()]
    (tmp_path / "six.toml").write_text(f"[positions]\nlisted = [{', '.join(rows)}]\n")
    return tmp_path / "six.toml"


@pytest.fixture
def grid(tmp_path):
    """A plan of 24 positions, with a mounting and gravity."""
    positions = "[positions]\nbeta_deg = [0, 45, 90]\nalpha_deg = [0, 45, 90, 135, 180, 225, 270, 315]\n"
    stated = '[session]\nmount = "B"\n[site]\ngravity_ms2 = 9.80665\n'
    (tmp_path / "plan.toml").write_text(stated + positions)
    return tmp_path / "plan.toml"
