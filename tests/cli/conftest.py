"""Files that commands read."""

import pytest


@pytest.fixture
def table1_file(tmp_path, table1):
    """Table 1 as a user's file."""
    from tumblecal.data import write_positions

    path = tmp_path / "table1.csv"
    write_positions(path, table1)
    return path
