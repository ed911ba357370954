"""Conditions of the positions, as variables of a figure."""

import numpy as np

from tumblecal.data import PositionSet


def conditions(data: PositionSet) -> dict[str, tuple[str, np.ndarray]]:
    """Unit and values of time and temperature, if they were recorded."""
    known = {}
    if data.time_s is not None:
        known["time"] = "min", (data.time_s - data.time_s.min()) / 60
    if data.temperature_degc is not None:
        known["temperature"] = "°C", data.temperature_degc
    return known
