"""Position means with temperatures, of `reduce` or `capture`, as rows over temperature.

Rules: if the temperatures of one clock form soaks (`ground/soaks.py`), successive positions of one soak are one. Otherwise,
successive positions whose temperatures are within a bin of each other are a run; a run that spans less than a bin is a soak.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.capture.journal import JOURNAL_NAME
from tumblecal.ground.errors import InputError
from tumblecal.ground.soaks import soak_numbers
from tumblecal.recordings.options import KnownContext, RecordingOptions
from tumblecal.recordings.own_tables import with_context
from tumblecal.recordings.reduce import position_file, reduced
from tumblecal.recordings.still.intervals import grouped
from tumblecal.recordings.thermal.temperature import branches, stretches_of_temperature
from tumblecal.recordings.thermal.thermal_table import INDEPENDENT, READINGS, SDS, ThermalTable


def positions_of(
    path: Path, name: str, prefix: str, context: KnownContext, options: RecordingOptions, noise_sd: float | None
) -> ThermalTable | None:
    """The rows of a source with one row for each position, without branches: the folder of a capture, any table with `--means`,
    or a table with angles. None for a recording of samples.

    **Arguments:** `name`: for labels; `prefix`: of labels of unknown attitudes. `noise_sd`: stated standard deviation of the
    readings, g; None: that of the columns.

    **Raises:** `InputError` for positions without temperatures, with impossible ones, or without standard deviations.
    """
    captured = (path / JOURNAL_NAME).is_file()
    data = None if captured else position_file(path, context, options)
    if data is None:
        if not (captured or context.means):
            return None
        data = (reduced([path]) if captured else reduced([path], replace(context, table=None), options)).data
    data = with_context(data, context)
    if data.temperature_degc is None:
        raise InputError(f"{path}: column temperature_degc is missing; write the temperature of each position in degC")
    sd = data.sd if noise_sd is None else np.full_like(data.readings, noise_sd)
    if sd is None:
        raise InputError(
            f"{path}: no standard uncertainties of the means; give --noise-sd 0.1mg, or write the columns ax_sd_g, ay_sd_g, "
            "az_sd_g"
        )
    count = len(data)
    n = np.ones(count) if data.n is None else data.n
    mount, clock = (pl.Series(labels or [""] * count) for labels in (data.mount, data.clock))
    frame = pl.DataFrame(np.column_stack([data.readings, sd, n, n, n]), [*READINGS, *SDS, *INDEPENDENT])
    frame = frame.with_columns(
        run=(name + " " + clock).str.strip_chars(),
        mount=mount.replace("", None),
        n=n,
        temperature_degc=data.temperature_degc,
        time_s=60.0 * np.arange(count) if data.time_s is None else data.time_s,
    )
    if data.hand_held:
        labels = [f"{prefix}a{k + 1}" for k in grouped(data.readings)[0]]
    else:
        angles = zip(data.alpha_deg.tolist(), data.beta_deg.tolist(), mount, strict=True)
        labels = [f"alpha {alpha:g} beta {beta:g} {mount}".strip() for alpha, beta, mount in angles]
        frame = frame.with_columns(alpha_deg=data.alpha_deg, beta_deg=data.beta_deg)
    return ThermalTable(frame.with_columns(position=pl.Series(labels)), data.source, dict(data.comments))


def with_branches(table: ThermalTable, bin_degc: float) -> ThermalTable:
    """The rows of `positions_of` with the branch and the rate of each, in the order of their times, for bins of this width."""
    parts = list[pl.DataFrame]()
    for rows in table.frame.partition_by("run", maintain_order=True):
        rows = rows.sort("time_s", maintain_order=True)
        degc, time_s = rows["temperature_degc"].to_numpy(), rows["time_s"].to_numpy()
        number = soak_numbers(degc)
        edges = np.abs(np.diff(degc)) > bin_degc if number is None else np.diff(number) != 0
        soak, rate = np.full(len(rows), -1), np.zeros(len(rows))
        for run in np.split(np.arange(len(rows)), np.flatnonzero(edges) + 1):
            warmth, at = degc[run], time_s[run] - time_s[run[0]]
            if at.any():
                rate[run] = np.polyfit(at, warmth, 1)[0]
            if number is not None or np.ptp(warmth) <= bin_degc:
                soak[run] = soak.max() + 1
            elif len(run) > 2 and (np.diff(at) > 0).all():
                rate[run] = np.gradient(warmth, at)
        found = branches(*stretches_of_temperature(degc, bin_degc), soak)
        parts.append(rows.hstack(found).with_columns(branch=pl.format("{}:{}", "run", "branch"), rate_degc_per_s=rate))
    return replace(table, frame=pl.concat(parts))
