"""Position means with temperatures, of `reduce` or `capture`, as rows over temperature.

Rules: if the temperatures of one clock form soaks (`ground/soaks.py`), successive positions of one soak are one. Otherwise,
successive positions whose temperatures are within a bin of each other are a run; a run that spans less than a bin is a soak.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.journal import JOURNAL_NAME
from tumblecal.data.conditions import are_kelvin, temperature_faults
from tumblecal.data.files import read_positions
from tumblecal.data.positions import PositionSet
from tumblecal.data.raw import column_names
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.ground.soaks import soak_numbers
from tumblecal.recordings.options import KnownContext, RecordingOptions
from tumblecal.recordings.reduce import reduced
from tumblecal.recordings.thermal.attitudes import grouped
from tumblecal.recordings.thermal.branches import stretches_of_temperature, threshold_of, with_soaks
from tumblecal.recordings.thermal.thermal_table import ThermalTable, joined


# This many consecutive rows of one position are samples of a recording.
_LIKE_SAMPLES = 16


def are_positions(path: Path, context: KnownContext, *, stated: bool = False) -> bool:
    """Whether a source has one row for each position: the folder of a capture, a file with standard deviations of means
    (`ax_sd_g`) or numbers of samples (`n`), or any table with `--means`; with angles, also one whose noise is `stated`."""
    if path.is_dir():
        return (path / JOURNAL_NAME).is_file()
    if context.means:
        return True
    names = _columns(path)
    of_means = {"ax_sd_g", "ax_sd_mg", "ax_sd_ms2", "n"}
    return "alpha_deg" in names and (stated or not of_means.isdisjoint(names))


def _columns(path: Path) -> tuple[str, ...]:
    """The columns of a CSV or Parquet file; none for others."""
    return tuple(column_names(path)) if path.suffix in (".csv", ".parquet") and path.is_file() else ()


def positions_of(
    path: Path, context: KnownContext, options: RecordingOptions, noise_sd: float | None = None
) -> PositionSet:
    """The positions of such a source.

    **Arguments:**

    - `noise_sd`: stated standard deviation of the readings, g; None: that of the columns.

    **Raises:** `InputError` for positions without temperatures, with impossible ones, or without standard deviations; for
    samples of a recording.
    """
    if path.is_dir():
        data = reduced([path]).data
    elif context.means and (options != RecordingOptions() or "position" not in _columns(path)):
        data = reduced([path], replace(context, table=None), options).data
    else:
        data = read_positions(path)
    labels = {name: (text,) * len(data) for name in ("run", "mount") if (text := getattr(context, name))}
    data = replace(data, **labels)  # type: ignore[arg-type]
    warmth = data.temperature_degc
    if warmth is None:
        raise InputError(f"{path}: column temperature_degc is missing; write the temperature of each position in degC")
    if are_kelvin(warmth):
        raise InputError(f"{path}: temperatures {warmth.min():.4g} to {warmth.max():.4g} are in kelvin; write degC")
    for row, fault in temperature_faults(warmth):
        raise InputError(f"{path}: position {data.names[row]}: temperature {fault}")
    if len(data) >= _LIKE_SAMPLES * data.stretches:
        raise InputError(
            f"{path}: {len(data)} rows, but only {counted(data.stretches, 'stretch')} of one position each, so these are "
            "samples, whose noise is measured; remove --noise-sd"
        )
    if noise_sd is not None:
        return replace(data, sd=np.full(data.readings.shape, noise_sd))
    if data.sd is None:
        raise InputError(
            f"{path}: no standard uncertainties of the means; give --noise-sd 0.1mg, or write the columns ax_sd_g, ay_sd_g, "
            "az_sd_g"
        )
    return data


def rows_of_positions(data: PositionSet, name: str, bin_degc: float, *, own: bool) -> ThermalTable:
    """The rows of position means.

    **Arguments:**

    - `data`: as of `positions_of`. `name`: for labels. `bin_degc`: width of a bin.
    - `own`: whether unknown attitudes have labels of this file.
    """
    clocks = np.array(data.clock or ("",) * len(data))
    attitude = _attitudes(data, f"{name}:" if own else "")
    tables = [
        _of_clock(data, np.flatnonzero(clocks == clock), f"{name} {clock}".strip(), attitude, bin_degc)
        for clock in dict.fromkeys(clocks.tolist())
    ]
    return replace(joined(tables, data.source), comments=data.comments)


def _attitudes(data: PositionSet, prefix: str) -> list[str]:
    """A label for each row: equal for equal angles and mountings, or, for unknown angles, for equal directions."""
    if data.hand_held:
        return [f"{prefix}a{k + 1}" for k in grouped(data.readings)[0].tolist()]
    mounts = data.mount or ("",) * len(data)
    keys = list(zip(data.alpha_deg.tolist(), data.beta_deg.tolist(), mounts, strict=True))
    mounted = len(set(mounts)) > 1
    return [f"alpha {alpha:g} beta {beta:g}" + (f" mount {mount}" if mounted else "") for alpha, beta, mount in keys]


def _of_clock(
    data: PositionSet, rows: NDArray[np.int64], clock: str, attitude: list[str], bin_degc: float
) -> ThermalTable:
    """The rows of one clock, in the order of their times."""
    assert data.temperature_degc is not None and data.sd is not None
    time = data.time_s if data.time_s is not None else 60.0 * np.arange(len(data))
    rows = rows[np.argsort(time[rows], kind="stable")]
    degc, time = data.temperature_degc[rows], time[rows]
    stretch, sign = stretches_of_temperature(degc, threshold_of(bin_degc, 0.0, 0.0))
    number = soak_numbers(degc)
    edges = np.abs(np.diff(degc)) > bin_degc if number is None else np.diff(number) != 0
    runs = np.split(np.arange(len(rows)), np.flatnonzero(edges) + 1)
    soak, rate, soaks = np.full(len(rows), -1), np.zeros(len(rows)), 0
    for run in runs:
        if len(run) > 1 and np.ptp(time[run]) > 0:
            rate[run] = np.polyfit(time[run] - time[run[0]], degc[run], 1)[0]
        if number is not None or np.ptp(degc[run]) <= bin_degc:
            soak[run], soaks = soaks, soaks + 1
        elif len(run) > 2:
            rate[run] = np.gradient(degc[run], time[run]) if (np.diff(time[run]) > 0).all() else rate[run]
    branches = with_soaks(stretch, sign, soak)
    n = data.n[rows] if data.n is not None else np.ones(len(rows))
    return ThermalTable(
        attitude=tuple(attitude[row] for row in rows),
        readings=data.readings[rows],
        sd=data.sd[rows],
        n=n,
        temperature_degc=degc,
        time_s=time,
        rate_degc_per_s=rate,
        branch=tuple(branches.label(clock, k) for k in branches.stretch.tolist()),
        direction=branches.direction,
        reached_by=branches.reached_by,
        clock=(clock,) * len(rows),
        n_eff=np.repeat(n[:, None], 3, axis=1),
        alpha_deg=None if data.hand_held else data.alpha_deg[rows],
        beta_deg=None if data.hand_held else data.beta_deg[rows],
        mount=None if data.mount is None else tuple(data.mount[row] for row in rows),
        source=data.source,
    )
