"""Samples of a hand-held session, healthy and damaged as loggers do it: columns by name, numpy only."""

from collections.abc import Iterator

import numpy as np
from recordings_made import ATTITUDES

from hand_held_sessions import Hand, session


RATE_HZ = 100.0
AXES = ("ax_g", "ay_g", "az_g")
ERASED = {
    "all bits set": (4294967.295, -1 / 16384),
    "zeros": (0.0, 0.0),
    "clock stays": (None, 0.7),
    "no number": (np.nan, np.nan),
    "a number beyond all": (3.4e38, 3.4e38),
}


def forces(rate_hz: float = RATE_HZ, offset_g: float = 0.0, sigma_g: float = 1e-3) -> np.ndarray:
    """Accelerations in g (n, 3) of eight attitudes and the turns between them."""
    force = session(3, ATTITUDES, Hand(rate_hz=rate_hz, sigma_g=sigma_g, dwell_s=(1.7, 2.2))).force
    return force + offset_g * np.array([1.0, -1.0, 0.5])


def table(force: np.ndarray, rate_hz: float = RATE_HZ, names: tuple[str, ...] = AXES) -> dict[str, np.ndarray]:
    """Columns of a recording with times in s."""
    return {"time_s": np.arange(len(force)) / rate_hz, **dict(zip(names, force.T, strict=True))}


def rows(columns: dict[str, np.ndarray], which: np.ndarray) -> dict[str, np.ndarray]:
    """Some rows of all columns."""
    return {name: values[which] for name, values in columns.items()}


def with_erased(columns: dict[str, np.ndarray], kind: str, at: int, count: int) -> dict[str, np.ndarray]:
    """Rows of erased memory before row `at`."""
    time, reading = ERASED[kind]
    damaged = {}
    for name, values in columns.items():
        number = reading if name != "time_s" else values[max(at - 1, 0)] if time is None else time
        damaged[name] = np.insert(values, at, np.full(count, number))
    return damaged


def orders(count: int) -> Iterator[tuple[str, int, np.ndarray]]:
    """What was done, how many rows were moved, and the rows in the order of the file."""
    own = np.arange(count)
    swapped = own.copy()
    first = np.arange(5, count - 2, count // 20)
    swapped[first], swapped[first + 1] = own[first + 1], own[first]
    yield "neighbours exchanged", len(first), swapped
    yield "packets exchanged", 10, np.concatenate([own[:500], own[510:520], own[500:510], own[520:]])
    yield "first packets exchanged", 10, np.concatenate([own[10:20], own[:10], own[20:]])
    yield "a late row", 1, np.concatenate([own[:500], own[501:700], own[500:501], own[700:]])
    yield "halves exchanged", count // 3, np.concatenate([own[count // 3 :], own[: count // 3]])
