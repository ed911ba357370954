"""Position sets, CSV and Parquet files, calibration files, tables of the paper. Does not need JAX."""

from tumblecal.data.files import read_positions, write_positions
from tumblecal.data.positions import PositionSet


__all__ = [
    "PositionSet",
    "read_positions",
    "write_positions",
]
