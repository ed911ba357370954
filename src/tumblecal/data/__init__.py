"""Position sets, CSV and Parquet files, calibration files, tables of the paper. Does not need JAX."""

from tumblecal.data.calibration import Calibration, read_calibration, write_calibration
from tumblecal.data.files import read_positions, write_positions
from tumblecal.data.positions import PositionSet


__all__ = [
    "Calibration",
    "PositionSet",
    "read_calibration",
    "read_positions",
    "write_calibration",
    "write_positions",
]
