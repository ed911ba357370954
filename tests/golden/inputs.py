"""Small inputs of the golden cases, by numpy alone: positions, recordings at rest, soaks, plans."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

import in_use_instrument as truth
from hand_held_sessions import Hand, session
from in_use_instrument import Schedule


SIGMA = 1e-4
G = 9.80665
FACES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
FACE_NAMES = ("x_up", "x_down", "y_up", "y_down", "z_up", "z_down")
# Alpha and beta (deg) of the faces.
FACE_ANGLES = ((0, -90), (0, 90), (90, 0), (-90, 0), (0, 0), (180, 0))
ATTITUDES = [[0, 0, 1], [0, 0.7, 0.714], [0, 1, 0], [0.6, -0.8, 0], [0.5, 0.5, -0.7], [-1, 0, 0], [0, -0.6, -0.8],
             [0.8, 0.1, 0.6], [-0.5, 0.6, 0.6], [0.3, -0.9, 0.2]]  # fmt: skip


def write_table(path: Path, columns: Mapping[str, Sequence], comments: Mapping[str, object] | None = None) -> None:
    """A CSV file with comments."""
    lines = [f"# {key}: {value}" for key, value in (comments or {}).items()]
    lines.append(",".join(columns))
    lines += [",".join(str(cell) for cell in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def plan_of(name: str = "3x8", seed: int = 1) -> tuple[Schedule, np.ndarray]:
    """A plan of a head, and the rotations of its mountings."""
    return truth.schedule(name, np.random.default_rng([seed, 7]))


def readings(
    plan: Schedule, turns: np.ndarray, seed: int, effects: Sequence[str] = (), size: float = 15.0
) -> np.ndarray:
    """Readings (n, 3) in g of a random instrument, with effects whose visible part is `size` standard deviations, and noise."""
    rng = np.random.default_rng([seed, 8])
    own = truth.instrument(plan, turns, rng, list(effects))
    if effects:
        share, _ = truth.shown_share(own, plan, SIGMA)
        own = truth.replace(own, effects={name: value * size / share for name, value in own.effects.items()})
    return truth.readings(own, plan) + SIGMA * rng.normal(size=(len(plan.alpha), 3))


def positions_table(plan: Schedule, values: np.ndarray, *, conditions: bool = True) -> dict[str, list]:
    """Columns of a position file."""
    columns = {
        "position": [f"p{k + 1}" for k in range(len(values))],
        "alpha_deg": np.degrees(plan.alpha).round(6).tolist(),
        "beta_deg": np.degrees(plan.beta).round(6).tolist(),
    }
    columns |= {f"a{axis}_g": values[:, k].round(9).tolist() for k, axis in enumerate("xyz")}
    if conditions:
        columns |= {
            "time_s": plan.time_s.round(2).tolist(),
            "temperature_degc": plan.temperature_degc.round(3).tolist(),
        }
    if plan.mounting.max() > 0:
        columns["mount"] = ["AB"[k] for k in plan.mounting]
    return columns


def write_positions(
    path: Path,
    seed: int,
    effects: Sequence[str] = (),
    *,
    plan: str = "3x8",
    size: float = 15.0,
    conditions: bool = True,
    comments: Mapping[str, object] | None = None,
) -> None:
    """A position file of a random instrument on one plan for all seeds."""
    schedule, turns = plan_of(plan)
    values = readings(schedule, turns, seed, effects, size)
    stated = {"gravity_ms2": 9.81} | dict(comments or {})
    write_table(path, positions_table(schedule, values, conditions=conditions), stated)


def triad(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrix (3, 3) and bias (3,) of a random triad: readings = matrix @ force + bias."""
    rng = np.random.default_rng([seed, 9])
    g21, g31, g32 = rng.normal(0, 1e-3, 3)
    return np.diag(1 + rng.normal(0, 4e-3, 3)) @ [[1, 0, 0], [g21, 1, 0], [g31, g32, 1]], rng.normal(0, 0.01, 3)


def write_by_hand(path: Path, seed: int, *, tilt_deg: float = 0.0, count: int = 6, angles: bool = True) -> None:
    """Means of faces, or of attitudes without angles, set by hand."""
    rng = np.random.default_rng([seed, 10])
    units = FACES if count == 6 else rng.normal(size=(count, 3))
    units = units + np.radians(tilt_deg) * rng.normal(size=units.shape)
    units /= np.linalg.norm(units, axis=1, keepdims=True)
    matrix, bias = triad(seed)
    values = units @ matrix.T + bias + SIGMA * rng.normal(size=units.shape)
    columns: dict[str, list] = {"position": [f"p{k + 1}" for k in range(len(units))]}
    if angles:
        columns |= {name: [pair[k] for pair in FACE_ANGLES] for k, name in enumerate(("alpha_deg", "beta_deg"))}
    columns |= {f"a{axis}_g": values[:, k].round(7).tolist() for k, axis in enumerate("xyz")}
    write_table(path, columns)


def recording(seed: int = 1, attitudes: Sequence = ATTITUDES) -> dict[str, np.ndarray]:
    """A session by hand at 100 Hz: time in s, force in g, rate in deg/s, temperature."""
    made = session(seed, np.array(attitudes, float), Hand())
    columns = {"time_s": made.time_s} | {f"a{axis}": made.force[:, k] for k, axis in enumerate("xyz")}
    return columns | {f"g{axis}": made.rate[:, k] for k, axis in enumerate("xyz")} | {"temperature": made.warmth}


def write_soaks(folder: Path, temperatures: Sequence[float], seed: int) -> None:
    """A file of 20 s at 5 Hz for each face at each temperature."""
    rng = np.random.default_rng([seed, 11])
    matrix, bias = triad(seed)
    slope = rng.normal(0, 3e-4, 3)
    for degc in temperatures:
        for face, name in zip(FACES, FACE_NAMES, strict=True):
            n = 100
            warm = degc + np.linspace(0, 0.4, n)
            values = face @ matrix.T + bias + (warm - 25)[:, None] * slope + 1e-3 * rng.normal(size=(n, 3))
            columns = {"time_s": (np.arange(n) / 5).round(2).tolist()}
            columns |= {f"a{axis}_g": values[:, k].round(6).tolist() for k, axis in enumerate("xyz")}
            write_table(folder / f"T{degc:g}_{name}.csv", columns | {"temperature_degc": warm.round(2).tolist()})


def write_ramps(folder: Path, seed: int) -> None:
    """A ramp from 10 to 45 degC at each face, 1 Hz."""
    rng = np.random.default_rng([seed, 12])
    matrix, bias = triad(seed)
    slope, curve = rng.normal(0, 3e-4, 3), rng.normal(0, 5e-6, 3)
    for face, name in zip(FACES, FACE_NAMES, strict=True):
        n = 900
        warm = np.linspace(10, 45, n)
        added = (warm - 25)[:, None] * slope + ((warm - 25) ** 2)[:, None] * curve
        values = face @ matrix.T + bias + added + 1e-3 * rng.normal(size=(n, 3))
        columns = {"time_s": np.arange(n).tolist()}
        columns |= {f"a{axis}_g": values[:, k].round(6).tolist() for k, axis in enumerate("xyz")}
        write_table(folder / f"{name}.csv", columns | {"temperature_degc": warm.round(2).tolist()})
