"""Position sets, units, CSV and Parquet, calibration files, the paper's tables. Needs no JAX."""

from tumblecal.data.files import read_positions as read_positions
from tumblecal.data.files import write_positions as write_positions
from tumblecal.data.positions import PositionSet as PositionSet
