"""Simulated hand-held sessions: a triad is laid or held on one side after another, with turns between.

    python benchmarks/hand_held_sessions.py --sessions 200 --seed 1

says how many of the true still intervals `tumblecal reduce --static` finds, and how many of those it takes are false: outside
a true one by more than a tenth of a second, or over two. Noise, rate, tremor, outliers, drift, number and length of the
dwells are drawn for each session.
"""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl

from command_line import asked
from tumblecal.recordings.still.blocks import blocks_of
from tumblecal.recordings.still.stillness import still_intervals


_EDGE_S = 0.1
_COVERED = 0.5


@dataclass(frozen=True)
class Session:
    """Samples: time in s, force in g (n, 3), rate in deg/s (n, 3), temperature in degC; `still` (k, 2) rows of the dwells."""

    time_s: np.ndarray
    force: np.ndarray
    rate: np.ndarray
    warmth: np.ndarray
    still: np.ndarray


@dataclass(frozen=True)
class Hand:
    """How a session goes: lengths in s, noise and `tremor_g` of the dwells in g; `outliers` a sample; `drift_g` over all."""

    rate_hz: float = 100.0
    dwell_s: tuple[float, float] = (3.0, 4.0)
    turn_s: tuple[float, float] = (0.6, 1.5)
    sigma_g: float = 2e-3
    tremor_g: float = 0.0
    outliers: float = 0.0
    drift_g: float = 0.0


def session(seed: int, attitudes: np.ndarray, hand: Hand) -> Session:
    """White noise, a hand's tremor in each dwell, smooth turns with accelerations of their own between."""
    rng = np.random.default_rng(seed)
    units = attitudes / np.linalg.norm(attitudes, axis=1, keepdims=True)
    force, rate, still, rows = [], [], [], 0
    for k, unit in enumerate(units):
        count = round(rng.uniform(*hand.dwell_s) * hand.rate_hz)
        shaken = hand.tremor_g * rng.uniform(0.0, 1.0)
        force.append(unit + shaken * tremor(rng, count, hand.rate_hz))
        rate.append(100 * shaken * tremor(rng, count, hand.rate_hz))
        still.append((rows, rows + count))
        rows += count
        if k + 1 < len(units):
            turned, spun = turn(
                rng, (unit, units[k + 1]), round(rng.uniform(*hand.turn_s) * hand.rate_hz), hand.rate_hz
            )
            force.append(turned)
            rate.append(spun)
            rows += len(turned)
    time_s = np.arange(rows) / hand.rate_hz
    whole = np.concatenate(force) * 1.01 + [0.02, -0.03, 0.05] + hand.sigma_g * rng.normal(size=(rows, 3))
    whole += hand.drift_g * (time_s / time_s[-1])[:, None] * rng.normal(size=3)
    struck = rng.random((rows, 3)) < hand.outliers
    whole = np.where(struck, whole + rng.normal(size=(rows, 3)), whole)
    spun = np.concatenate(rate) + [0.4, -0.2, 0.1] + 0.05 * rng.normal(size=(rows, 3))
    return Session(time_s, whole, spun, 25 + 0.01 * time_s, np.array(still))


def tremor(rng: np.random.Generator, count: int, rate_hz: float) -> np.ndarray:
    """A few oscillations of 4 to 12 Hz, as of a hand, (count, 3), of size about one."""
    times = np.arange(count) / rate_hz
    waves = [np.sin(2 * np.pi * rng.uniform(4, 12) * times + rng.uniform(0, 6)) for _ in range(4)]
    return np.stack(waves, axis=1) @ rng.normal(size=(4, 3)) / 2


def turn(
    rng: np.random.Generator, ends: tuple[np.ndarray, np.ndarray], count: int, rate_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """Force (g) and rate (deg/s) of a smooth turn from one direction to another."""
    start, end = ends
    axis = np.cross(start, end)
    axis = axis if np.linalg.norm(axis) > 1e-6 else np.cross(start, [0.3, 0.5, 0.81])
    axis = axis / np.linalg.norm(axis)
    angle = np.arctan2(np.linalg.norm(np.cross(start, end)), start @ end)
    x = np.linspace(0, 1, count)
    turned = angle * (10 * x**3 - 15 * x**4 + 6 * x**5)
    cos, sin = np.cos(turned)[:, None], np.sin(turned)[:, None]
    force = start * cos + np.cross(axis, start) * sin + axis * (axis @ start) * (1 - cos)
    shaken = 0.08 * np.sin(np.pi * x)[:, None] * tremor(rng, count, rate_hz)
    return force + shaken, np.degrees(np.gradient(turned, 1 / rate_hz))[:, None] * axis


def apart(rng: np.random.Generator, count: int) -> np.ndarray:
    """Random directions, each at least 20 degrees from the one before."""
    units: list[np.ndarray] = []
    while len(units) < count:
        own = rng.normal(size=3)
        own /= np.linalg.norm(own)
        if not units or own @ units[-1] < np.cos(np.radians(20)):
            units.append(own)
    return np.array(units)


def drawn(seed: int) -> Session:
    """A session of a kind drawn at random."""
    rng = np.random.default_rng([seed, 17])
    hand = Hand(
        rate_hz=float(rng.choice([50.0, 100.0, 200.0, 400.0])),
        dwell_s=(2.5, float(rng.uniform(3.0, 8.0))),
        turn_s=(0.5, float(rng.uniform(1.0, 3.0))),
        sigma_g=10 ** rng.uniform(-3.7, -2.3),
        tremor_g=float(rng.choice([0.0, 1e-3, 3e-3, 6e-3])),
        outliers=float(rng.choice([0.0, 3e-4, 1e-3])),
        drift_g=float(rng.choice([0.0, 5e-3])),
    )
    return session(seed, apart(rng, int(rng.integers(9, 31))), hand)


def counts(s: Session, *, with_rates: bool) -> tuple[int, int, int, int]:
    """True intervals, those found, intervals taken, and those among them that are false."""
    rate_hz = 1 / (s.time_s[1] - s.time_s[0])
    columns = {f"a{axis}_g": s.force[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"g{axis}_dps": s.rate[:, k] for k, axis in enumerate("xyz")} if with_rates else {}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "s.parquet"
        pl.DataFrame(columns | {"time_s": s.time_s}).write_parquet(path)
        taken = still_intervals(blocks_of(path, list(columns), rate_hz, timed=True)).used
    spans = np.array([(one.start, one.stop) for one in taken]).reshape(-1, 2)
    edge = _EDGE_S * rate_hz
    within = (spans[:, None, 0] >= s.still[None, :, 0] - edge) & (spans[:, None, 1] <= s.still[None, :, 1] + edge)
    lengths = np.where(within, spans[:, None, 1] - spans[:, None, 0], 0).sum(0)
    found = lengths >= _COVERED * (s.still[:, 1] - s.still[:, 0])
    return len(s.still), int(found.sum()), len(spans), int((~within.any(1)).sum())


def write_log(path: Path | str, positions: int, seed: int) -> None:
    """A session of a million rows: time, accelerations in m/s^2, rates in rad/s, temperature."""
    dwell_s = 1000.0 / positions - 1.0
    hand = Hand(rate_hz=1000.0, dwell_s=(0.75 * dwell_s, 1.25 * dwell_s), turn_s=(0.5, 1.5), tremor_g=1e-3)
    s = session(seed, apart(np.random.default_rng(seed), positions), hand)
    columns = {"time": s.time_s} | {f"acc_{axis}": 9.80665 * s.force[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"gyr_{axis}": np.radians(s.rate[:, k]) for k, axis in enumerate("xyz")} | {"temp": s.warmth}
    pl.DataFrame(columns).write_csv(path, float_precision=6)


def main() -> None:
    given = asked(__doc__, sessions=200, seed=1)
    for with_rates in (False, True):
        sessions = (drawn(given.seed + number) for number in range(given.sessions))
        rows = [counts(s, with_rates=with_rates) for s in sessions]
        true, found, taken, false = np.sum(rows, axis=0)
        words = "with angular rates" if with_rates else "accelerations alone"
        print(
            f"{words}: {found} of {true} true intervals found ({found / true:.2%}); "
            f"{false} of {taken} false ({false / taken:.2%})"
        )


if __name__ == "__main__":
    main()
