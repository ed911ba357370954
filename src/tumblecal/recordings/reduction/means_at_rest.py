"""Means of the intervals at rest of a table of samples, with the attitudes of a plan, of files, or unknown ones."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.data.column_names import FORCE, RATE
from tumblecal.data.parquet import scan_parquet
from tumblecal.data.positions import PositionSet, attitudes_of
from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import Criterion
from tumblecal.recordings.reduction.reduce_table import enough_samples
from tumblecal.recordings.reduction.reduction import Reduction, reduction_of
from tumblecal.recordings.still.blocks import blocks_of, pieces_of
from tumblecal.recordings.still.stillness import Stillness, still_intervals


# Names, alpha and beta (deg), and approach of positions; None for unknown ones.
Attitudes = tuple[tuple[str, ...], NDArray[np.float64] | None, NDArray[np.float64] | None, NDArray[np.float64] | None]


class NothingStill(InputError):
    """No usable interval; `stillness` has the intervals found."""

    def __init__(self, fault: str, stillness: Stillness | None = None):
        super().__init__(fault)
        self.stillness = stillness

    def __reduce__(self) -> tuple[object, ...]:
        return NothingStill, (self.faults[0], self.stillness)


def stillness_of(samples: Path, rate_hz: float, criterion: Criterion, plan: CapturePlan | None) -> Stillness:
    """The intervals at rest of a table of samples, with the guard of a plan if it is longer."""
    columns = scan_parquet(samples, check=False)[0].collect_schema().names()
    channels = [name for name in columns if name[:2] in (*FORCE, *RATE)]
    if plan is not None:
        criterion = replace(criterion, guard_s=max(criterion.guard_s, plan.dwell.guard_s))
    return still_intervals(blocks_of(samples, channels, rate_hz, timed="time_s" in columns), criterion)


def check_still(path: Path, stillness: Stillness, to_g: float) -> None:
    """Check that a recording has a usable interval at rest.

    **Raises:** `NothingStill`, with the quietest second or the reasons against the intervals.
    """
    if not len(stillness.noise):
        raise NothingStill(
            f"{path}: {stillness.blocks.rows} samples are too few to find intervals at rest (for a table of means: --means)"
        )
    if not stillness.dof.any():
        noise_mg = float(stillness.noise[:3].max()) * to_g * 1e3
        raise NothingStill(
            f"{path}: no interval at rest: even in the quietest second the accelerations scatter by {noise_mg:.0f} mg",
            stillness,
        )
    if not stillness.used:
        reasons = "; ".join(f"{interval.start_s:.1f} s: {interval.reason}" for interval in stillness.intervals[:3])
        raise NothingStill(
            f"{path}: no interval at rest is long enough ({reasons or 'all moves'}); see --least-s", stillness
        )


def reduced_at_rest(
    path: Path,
    samples: Path,
    stillness: Stillness,
    to_g: float,
    attitudes: Attitudes,
    more: Mapping[str, Any],
    rate_hz: float,
    recording: str,
) -> Reduction:
    """The means of the used intervals at rest of a table of samples.

    **Arguments:**

    - `path`: the source, for faults. `to_g`: unit of the samples, g. `recording`: identifier of the recording.
    - `attitudes`: of the intervals. `more`: further arguments of the position set.
    """
    dwells, temperatures = _still_samples(samples, stillness)
    dwells = [dwell * to_g for dwell in dwells]
    readings = np.array([dwell.mean(0) for dwell in dwells])
    enough_samples(path, attitudes[0], dwells)
    data = replace(
        position_set(path, readings, attitudes),
        time_s=np.array([(interval.start_s + interval.stop_s) / 2 for interval in stillness.used]),
        temperature_degc=_mean_temperatures(temperatures),
        n=np.array([len(dwell) for dwell in dwells], float),
        **more,
    )
    return reduction_of(data, dwells, rate_hz, recording, temperatures=temperatures)


def position_set(path: Path, readings: NDArray[np.float64], attitudes: Attitudes) -> PositionSet:
    """Readings at these attitudes; unknown angles are suggested by the readings."""
    names, alpha, beta, approach = attitudes
    if alpha is None or beta is None:
        alpha, beta = attitudes_of(readings)
    return PositionSet(names, alpha, beta, readings, approach=approach, source=str(path))


def _still_samples(
    samples: Path, stillness: Stillness
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]] | None]:
    """The accelerations (n, 3) of each used interval, without knocks and outliers, and their temperatures."""
    there = scan_parquet(samples, check=False)[0].collect_schema().names()
    columns = [name for name in there if name[:2] in FORCE or name == "temperature_degc"]
    parts: list[list[NDArray[np.float64]]] = [[] for _ in stillness.used]
    alone = stillness.blocks.outliers
    for first, table in pieces_of(samples, columns):
        for part, interval in zip(parts, stillness.used, strict=True):
            start, stop = max(interval.start, first), min(interval.stop, first + len(table))
            if start >= stop:
                continue
            good = np.ones(stop - start, bool)
            good[alone[(alone >= start) & (alone < stop)] - start] = False
            for from_row, to_row in interval.knocks:
                good[max(from_row - start, 0) : max(to_row - start, 0)] = False
            part.append(table[start - first : stop - first][good])
    whole = [np.concatenate(part) for part in parts]
    temperatures = [part[:, 3] for part in whole] if len(columns) > 3 else None
    return [np.ascontiguousarray(part[:, :3]) for part in whole], temperatures


def _mean_temperatures(temperatures: list[NDArray[np.float64]] | None) -> NDArray[np.float64] | None:
    """The mean temperature of each interval; None if an interval has none."""
    finite = [temperature[np.isfinite(temperature)] for temperature in temperatures or []]
    return np.array([temperature.mean() for temperature in finite]) if finite and all(map(len, finite)) else None
