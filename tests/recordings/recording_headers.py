"""Files with the headers of loggers, phones, ROS, autopilots and vendors: `recording_headers.toml` explains the codes.

Columns and axes may be in another order, with a prefix or another case; offsets of 0 to 0.6 g, attitudes at rest or one.
"""

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np


TURN_ROWS, MOST_ROWS = 25, 6000
UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


@dataclass(frozen=True)
class Header:
    """A header line.

    **Arguments:**

    - `source`: the program that writes it. `names`: of the columns, in order; `codes`: the quantities in them.
    - `separator`: between cells. `per_g`: how many of its unit make one g; `per_dps` one deg/s.
    - `asks`: whether a question is the right answer (no gravity in it, two sensors, times without a unit).
    """

    source: str
    names: tuple[str, ...]
    codes: tuple[str, ...]
    separator: str = ","
    per_g: float = 9.80665
    per_dps: float = 1.0
    asks: bool = False


def _header(names: str, codes: str, separator: str = ",", **more) -> Header:
    columns = tuple(names.replace('"', "").split(separator))
    return Header(names=columns, codes=tuple(codes.split()), separator=separator, **more)


def headers_of(name: str) -> list[Header]:
    """The headers of a table in this folder."""
    table = tomllib.loads(Path(__file__).with_name(name).read_text(encoding="utf-8"))
    return [_header(**header) for header in table["headers"]]


HEADERS = headers_of("recording_headers.toml")


def motion(rng: np.random.Generator, rate_hz: float, attitudes: int) -> dict[str, np.ndarray]:
    """Directions of gravity and of the magnetic field, and rates in deg/s, (n, 3): turns between stretches at rest."""
    dwell = int(np.clip(rng.uniform(2.0, 4.0) * rate_hz, 20, MOST_ROWS / attitudes))
    turn = max(TURN_ROWS, int(0.3 * rate_hz)) if attitudes < MOST_ROWS / 200 else TURN_ROWS
    turn = min(turn, MOST_ROWS // attitudes)
    frames = [np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(attitudes)]
    dip = rng.uniform(0.3, 1.3)
    north = np.array([np.cos(dip), 0.0, -np.sin(dip)])
    blend = np.linspace(0, 1, turn)[:, None]
    blend = 10 * blend**3 - 15 * blend**4 + 6 * blend**5
    parts: dict[str, list[np.ndarray]] = {"up": [], "north": [], "rate": []}
    for k, frame in enumerate(frames):
        for name, vector in (("up", frame[:, 2]), ("north", frame @ north)):
            parts[name].append(np.tile(vector, (dwell, 1)))
            if k + 1 < attitudes:
                following = frames[k + 1][:, 2] if name == "up" else frames[k + 1] @ north
                between = (1 - blend) * vector + blend * following
                parts[name].append(between / np.maximum(np.linalg.norm(between, axis=1, keepdims=True), 0.2))
        parts["rate"].append(np.zeros((dwell, 3)))
        if k + 1 < attitudes:
            parts["rate"].append(
                rng.uniform(60, 250) * rng.normal(size=3) * np.sin(np.pi * np.linspace(0, 1, turn))[:, None] ** 2
            )
    return {name: np.concatenate(own) for name, own in parts.items()}


def columns_of(
    header: Header, rng: np.random.Generator, rate_hz: float, attitudes: int
) -> tuple[list[list[str]], np.ndarray]:
    """Cells of each column of a header, in its order, and the accelerations in them (n, 3), in its unit."""
    moved = motion(rng, rate_hz, attitudes)
    up, rows = moved["up"], len(moved["up"])
    gain = np.diag(1 + 0.02 * rng.uniform(-1, 1, 3)) @ (np.eye(3) + 0.01 * rng.normal(size=(3, 3)))
    offset, noise = rng.uniform(0, 0.6) * rng.uniform(-1, 1, 3), 10 ** rng.uniform(-3.3, -2.3)
    force = header.per_g * (up @ gain.T + offset + noise * rng.normal(size=(rows, 3)))
    smooth = header.per_g * (up @ gain.T + offset)
    step = max(header.per_g * 1e-5, 1.0 if header.per_g >= 256 and header.per_g != 1000 else 0.0)
    other = header.per_g * (up + rng.uniform(-0.1, 0.1, 3) + noise * rng.normal(size=(rows, 3)))
    pulled = moved["rate"] * 2e-3 * header.per_g * rng.normal(size=3)
    # Fusion removes all of gravity but some milli-g.
    free = pulled + header.per_g * (5e-3 * rng.normal(size=3) + noise * rng.normal(size=(rows, 3)))
    rate = header.per_dps * (moved["rate"] + rng.normal(size=3) + 0.05 * rng.normal(size=(rows, 3)))
    field = rng.choice([45.0, 450.0, 0.45, 160.0]) * (
        moved["north"] + 0.4 * rng.normal(size=3) + 0.01 * rng.normal(size=(rows, 3))
    )
    quaternion = np.column_stack([up, np.ones(rows)])
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    angles = np.degrees(np.arctan2(up, np.roll(up, 1, axis=1)))
    seconds = np.arange(rows) / rate_hz + rng.uniform(0, 1000)
    vectors = {
        "a": (np.round(force / step) * step, step), "s": (smooth, 1e-6 * header.per_g), "b": (other, 1e-6 * header.per_g),
        "l": (free, 1e-6 * header.per_g), "v": (header.per_g * up, 1e-6 * header.per_g), "g": (rate, 1e-5), "m": (field, 1e-4),
        "q": (quaternion, 1e-6), "e": (angles, 1e-3),
    }  # fmt: skip

    def cells(code: str) -> list[str]:
        if code == "tclock":
            return [f"{10 + int(s // 3600):02d}:{int(s // 60) % 60:02d}:{s % 60:09.6f}" for s in seconds]
        if code == "tdate":
            return [f"2024-05-03 {10 + int(s // 3600):02d}:{int(s // 60) % 60:02d}:{s % 60:09.6f}" for s in seconds]
        if code[0] == "t" and code[1:] in UNITS:
            scaled = seconds * UNITS[code[1:]]
            return [f"{value:.6f}" if code in ("ts", "tms") else str(int(value)) for value in scaled]
        if code == "n":
            return list(map(str, range(rows)))
        if code in ("k", "W"):
            return ["7" if code == "k" else "imu"] * rows
        if code == "f":
            return [f"{value:.4f}" for value in 0.1 * rng.normal(size=rows)]
        if code == "T":
            return [f"{value:.2f}" for value in 24 + np.linspace(0, 3, rows) + 0.01 * rng.normal(size=rows)]
        vector, resolution = vectors[code[0]]
        digits = max(0, int(np.ceil(-np.log10(resolution))))
        own = vector[:, "xyzw".index(code[1])]
        return [f"{value:.{digits}f}" for value in own]

    return [cells(code) for code in header.codes], vectors["a"][0]


def renamed(header: Header, rng: np.random.Generator) -> tuple[str, ...]:
    """The names with a prefix, or in capital or small letters, as other versions of a program write them."""
    how = rng.integers(5)
    if how == 0:
        prefix = rng.choice(["imu0_", "left/", "Sensor 3: ", "logger.", "MPU6050_"])
        return tuple(prefix + name for name in header.names)
    if how == 1:
        lower = tuple(name.lower() for name in header.names)
        return lower if len(set(lower)) == len(lower) else header.names
    return header.names


def shuffled(header: Header, rng: np.random.Generator) -> list[int]:
    """The columns in another order: whole triples moved, and the axes within them."""
    groups = list[list[int]]()
    for k, code in enumerate(header.codes):
        if groups and code[0] in "asblvgmqe" and header.codes[groups[-1][-1]][0] == code[0]:
            groups[-1].append(k)
        else:
            groups.append([k])
    groups = [groups[k] for k in rng.permutation(len(groups))] if rng.random() < 0.5 else groups
    indexed = "012" in re.sub(r"\D", "", "".join(header.names))
    return [k for group in groups for k in (rng.permutation(group) if rng.random() < 0.5 and not indexed else group)]
