"""The raw samples of every position: from a capture's folder, or from a table with a column `position`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.data import PositionSet
from tumblecal.data.cells import labels_in, number_in
from tumblecal.data.raw import read_raw
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.noise.within_dwells import without_common_change


# Means that differ more from those of the samples (standard deviations of the mean, and g) are not of these samples.
_FAR_SD, _FAR_G = 30.0, 2e-3
# Local gravity differs from standard gravity by less than this share.
_GRAVITY_SHARE = 6e-3
FEWEST = 16
# Positions in a message: with too few samples, and of a file with others.
_SHOWN, _SHOWN_OTHERS = 6, 4


@dataclass(frozen=True)
class PositionSamples:
    """Raw samples by position.

    **Arguments:**

    - `force`: by position name, g, shape (n, 3) each, without the change within dwells that all
      share. `middle_s`: middle of each dwell, s; empty if not recorded.
    - `rate_hz`: sample rate. `source`: where they were read from.
    """

    force: dict[str, NDArray[np.float64]]
    middle_s: dict[str, float]
    rate_hz: float
    source: str

    @property
    def dwell_s(self) -> float:
        """Length of the median dwell."""
        return float(np.median([len(samples) for samples in self.force.values()])) / self.rate_hz


def read_position_samples(path: Path) -> PositionSamples:
    """Read the raw samples of positions.

    **Arguments:**

    - `path`: folder of `tumblecal capture`, or a CSV or Parquet table with columns `position`, `ax_g, ay_g, az_g` (or
      `_mg`, `_ms2`) and `time_s`; without `time_s` a comment `# rate_hz: 100` gives the sample rate. With `_ms2` a comment
      `# gravity_ms2: 9.8123` gives local gravity.

    **Raises:** `InputError` if there are no such samples, or too few.
    """
    return _captured(path) if path.is_dir() else _table(path)


def _captured(folder: Path) -> PositionSamples:
    from tumblecal.recordings.reduction.reduce import reduce

    reduction = reduce(folder)
    names, middle_s = reduction.data.names, reduction.data.time_s
    assert middle_s is not None
    return PositionSamples(
        dict(zip(names, reduction.noise_samples, strict=True)),
        dict(zip(names, middle_s.tolist(), strict=True)),
        reduction.rate_hz,
        str(folder),
    )


def _table(path: Path) -> PositionSamples:
    raw = read_raw(path)
    if "position" not in raw.frame.columns:
        raise InputError(
            f"{path}: column position is missing; write the name of the position in the row of each sample"
        )
    label = labels_of(path, raw.frame["position"].to_list(), "position")
    names = list(dict.fromkeys(label.tolist()))
    force = {name: raw.readings[label == name] for name in names}
    few = [f"{name} ({len(samples)})" for name, samples in force.items() if len(samples) < FEWEST]
    if few:
        more = f" and {len(few) - _SHOWN} more" if len(few) > _SHOWN else ""
        raise InputError(
            f"{path}: too few samples at position {', '.join(few[:_SHOWN])}{more}; {FEWEST} are needed at each"
        )
    warmth = raw.temperature_degc()
    temperatures = None if warmth is None else [warmth[label == name] for name in names]
    timed = "time_s" in raw.frame.columns
    times = raw.numbers("time_s") if timed else np.zeros(0)
    rate = rate_of(path, [times[label == name] for name in names]) if timed else stated_rate(path, raw.comments)
    quiet, _ = without_common_change(list(force.values()), rate, temperatures)
    force = dict(zip(names, quiet, strict=True))
    if not timed:
        return PositionSamples(force, {}, rate, str(path))
    middle = {name: float(np.mean(times[label == name])) for name in names}
    return PositionSamples(force, middle, rate, str(path))


def labels_of(path: Path, cells: list[Any], column: str) -> NDArray[np.str_]:
    """Labels of the samples (for example of their positions), as for `labels_in`.

    **Raises:** `InputError` for empty cells.
    """
    if not cells:
        raise InputError(f"{path}: no rows; write a row for each sample")
    names = labels_in(cells)
    empty = sum(not name for name in names)
    if empty:
        raise InputError(f"{path}: column {column}: {empty} empty cells; write the {column} in the row of each sample")
    return np.array(names)


def rate_of(path: Path, dwells: list[NDArray[np.float64]]) -> float:
    """The sample rate from the times of each dwell's samples, Hz.

    **Raises:** `InputError` for times that do not increase.
    """
    steps = np.concatenate([np.diff(times) for times in dwells])
    step = float(np.median(steps))
    if not step > 0 or np.min(steps) <= 0:
        raise InputError(f"{path}: column time_s must increase from sample to sample within a position")
    return 1.0 / step


def stated_rate(path: Path, comments: dict[str, str]) -> float:
    """The sample rate of the comment `# rate_hz: 100`, Hz.

    **Raises:** `InputError` without this comment, or for an invalid rate.
    """
    text = comments.get("rate_hz")
    if text is None:
        raise InputError(f"{path}: the sample rate is not known; add a column time_s or a comment `# rate_hz: 100`")
    rate, _ = number_in(text)
    if np.isfinite(rate) and rate > 0:
        return rate
    raise InputError(
        f"{path}: comment rate_hz: {text!r} is not a sample rate in Hz; write for example `# rate_hz: 100`"
    )


def require_samples_of(samples: PositionSamples, data: PositionSet) -> None:
    """Raise for samples of other positions.

    **Raises:** `InputError` if a position has no samples, or their mean is different.
    """
    absent = [name for name in data.names if name not in samples.force]
    # Joined files prefix a position's name with the name of the file if several files have it.
    names = [name.partition(":")[2] for name in absent]
    repeated = [name for name in names if name in samples.force] or [n for n in data.names if data.names.count(n) > 1]
    if repeated:
        raise InputError(
            f"{data.source}: several positions are named {repeated[0]}, so their samples are indistinguishable in "
            f"{samples.source}; give each position a name of its own in both"
        )
    if absent:
        more = f" and {len(absent) - _SHOWN_OTHERS} more" if len(absent) > _SHOWN_OTHERS else ""
        there = ", ".join(list(samples.force)[:_SHOWN_OTHERS])
        raise InputError(
            f"{samples.source}: no samples of position {', '.join(absent[:_SHOWN_OTHERS])}{more} of {data.source}; "
            f"it has {there}{' ...' if len(samples.force) > _SHOWN_OTHERS else ''}"
        )
    for name, mean in zip(data.names, data.readings, strict=True):
        force = samples.force[name]
        off = np.abs(force.mean(0) - mean)
        allowed = _FAR_SD * force.std(0, ddof=1) / np.sqrt(len(force)) + _FAR_G
        if np.any(off > allowed):
            axis = int(np.argmax(off - allowed))
            raise InputError(
                f"{samples.source}: position {name}: the samples' mean of axis {AXES[axis]} is {force[:, axis].mean():.6g} "
                f"g, but {data.source} has {mean[axis]:.6g} g; give the samples that the means were made of"
                + _gravity_words(force, mean)
            )


def _gravity_words(force: np.ndarray, mean: np.ndarray) -> str:
    """The remedy if a mean differs like local gravity from standard gravity."""
    ratio = float(np.linalg.norm(force.mean(0)) / np.linalg.norm(mean))
    like_gravity = abs(ratio - 1) < _GRAVITY_SHARE and np.linalg.norm(force.mean(0) - ratio * mean) < _FAR_G
    return ", and for readings in m/s^2 a comment `# gravity_ms2: 9.8123` with local gravity" if like_gravity else ""
