"""The published numbers of Gao, Chen and Ren (2016), doi 10.19306/j.cnki.2095-8110.2016.03.012."""

import csv
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np

from tumblecal.data.files import read_positions
from tumblecal.data.positions import PositionSet


# Section 3: the truth of the paper's simulation, base units, in the order of the nominal chain.
SIMULATION_TRUTH = {
    "dK_x": 0.0002,
    "dK_y": -0.00012,
    "dK_z": 0.0003,
    "bias_x": 1.1e-3,
    "bias_y": -0.75e-3,
    "bias_z": 0.8e-3,
    "dtheta_x": 0.22e-3,
    "dtheta_y": -0.18e-3,
    "dtheta_z": 0.09e-3,
    "gamma_21": 0.13e-3,
    "gamma_31": -0.12e-3,
    "gamma_32": 0.22e-3,
    "dbeta_0": 1.5e-3,
    "dbeta_1": -1.8e-3,
    "dbeta_2": -2.1e-3,
}
SIMULATION_NOISE_G = 0.15e-3
SIMULATION_DATA_SETS = 600

# Section 4: sd of the raw data averaged over 1 s and 100 s, and how long each position was measured.
STATED_SD_G = {1.0: 1.2e-3, 100.0: 0.7e-3}
DWELL_S = 20 * 60.0


def _path(name: str) -> Path:
    return Path(str(files(__name__) / name))


def table1() -> PositionSet:
    """Table 1: position means of the first test (24 positions, g)."""
    return read_positions(_path("table1.csv"))


@lru_cache
def table2() -> dict[str, np.ndarray]:
    """Table 2: published parameters of the three runs, base units, by parameter name."""
    return {row[0]: np.array([float(cell) for cell in row[1:]]) for row in _rows("table2.csv")}


@lru_cache
def table3() -> dict[str, np.ndarray]:
    """Table 3: largest and smallest residual of the three runs, g."""
    return {row[0]: np.array([float(cell) for cell in row[1:]]) * 1e-3 for row in _rows("table3.csv")}


def _rows(name: str) -> list[list[str]]:
    lines = _path(name).read_text(encoding="utf-8").splitlines()
    return list(csv.reader(line for line in lines if not line.startswith("#")))[1:]
