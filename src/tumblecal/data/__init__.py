"""Position sets, units, CSV and Parquet, calibration files, the paper's tables. Needs no JAX."""

from tumblecal.data.files import read_positions, write_positions
from tumblecal.data.positions import PositionSet


__all__ = [
    "PositionSet",
    "read_positions",
    "write_positions",
]
