"""Positions that repeat others: copies and raw samples are reported; repeats of large data sets are averaged.

Limits for large data sets: repeats of a position are averaged; if that is not enough, the cost is stated or rejected.

The cost of a diagnosis grows with the square of the number of positions. Consecutive rows of the same attitude, run, mounting
and approach differ only by noise, so their mean has the same information on each effect. Slow changes (drift, temperature)
are preserved because only a few rows are averaged at a time. A row that differs from its repeats is not averaged, so that
exchanged, mislabelled and outlier positions can be identified by name.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Int

from tumblecal.data import PositionSet
from tumblecal.data.gravity_size import moving_fault, reduce_command
from tumblecal.data.table import KNOWN, READINGS, likely_meant
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted, duration, shortened
from tumblecal.ground.suggested_command import suggested


# Largest number of positions without averaging; number of means; largest number that is accepted without averaging.
MOST_ROWS, MEANS, REFUSED = 400, 240, 1000
# Largest number of positions of unknown attitude: each adds two unknowns, and the time grows with the third power.
_MOST_HAND_HELD = 600
# Time and memory of 1,000 positions on one core (benchmarks/command_speed.py rows); both grow with the square.
_SECONDS, _GIB_FIXED, _GIB = 55.0, 0.6, 2.2
# A reading further than this (robust standard deviations) from the median of its repeats is not averaged; at most so many.
_ALONE_FROM, _MOST_ALONE = 6.0, 20
# If the numbers of rows of the means differ by more than this factor, their sd are computed from the repeats.
_UNEQUAL = 2.0


_MOST_COPIES = 3


@dataclass(frozen=True)
class InBounds:
    """Positions to diagnose, the separately stated sd of each reading (g), and words on the averaging."""

    data: PositionSet
    noise_sd: float | None
    words: str = ""


def in_bounds(data: PositionSet, noise_sd: float | None, most: int | None = None, *, sampled: bool = False) -> InBounds:
    """At most `most` positions: if there are more, repeats are averaged.

    **Arguments:**

    - `noise_sd`: stated sd of every reading, g.
    - `most`: given by the user, the limit after averaging.
    - `sampled`: whether raw samples of the positions are given; these positions are not averaged.

    **Raises:** `InputError`, with the estimated cost, for more positions after averaging.
    """
    if most is None:
        require_few_attitudes(data)
    wanted = MOST_ROWS if most is None else most
    if len(data) <= wanted:
        return InBounds(data, noise_sd)
    groups = [] if sampled or data.hand_held else _groups(data, min(MEANS, wanted))
    if groups and len(groups) <= wanted:
        averaged = _averaged(data, groups, noise_sd)
        sizes = sorted({len(rows) for rows in groups})
        words = (
            f"{len(data)} rows are diagnosed as {len(groups)} means of up to {sizes[-1]} repeats each (same attitude, run and "
            f"mounting, consecutive); --max-rows {len(data)} uses each row separately ({cost(len(data))})."
        )
        if data.recorded_noise is not None and noise_sd is None:
            words += (
                " The noise model of the recording does not apply to such means: their noise is treated as unknown and "
                "independent."
            )
        return InBounds(averaged, None, words)
    if len(data) > (REFUSED if most is None else most):
        raise InputError(
            f"{data.source}: {len(data)} positions, which cannot be averaged to {wanted} (only rows of the same attitude, run "
            f"and mounting can). Without averaging they need {cost(len(data))}. Diagnose runs or parts separately, or allow "
            f"this with --max-rows {len(data)}"
        )
    return InBounds(data, noise_sd, f"{len(data)} positions: this needs {cost(len(data))}.")


def require_few_attitudes(data: PositionSet) -> None:
    """Reject a hand-held set that is too large.

    **Raises:** `InputError`.
    """
    if data.hand_held and len(data) > _MOST_HAND_HELD:
        many = (
            f"{len(data)} positions of unknown attitude, but at most {_MOST_HAND_HELD} are possible, because each adds two "
            "unknowns. Average rows of the same attitude; to find the intervals at rest of a recording, run: "
            f"{reduce_command(data)}"
        )
        raise InputError(f"{data.source}: {moving_fault(data) or many}")


def copied_positions(data: PositionSet) -> list[tuple[str, str]]:
    """Names of positions whose numbers all equal those of an earlier position, with the name of the earlier one."""
    columns = [data.alpha_deg, data.beta_deg, *data.readings.T, data.time_s, data.temperature_degc]
    columns = [column.tolist() for column in columns if column is not None]
    first, pairs = dict[tuple, str](), list[tuple[str, str]]()
    for name, *row in zip(data.names, *columns, data.labels("run"), data.labels("mount"), strict=True):
        if (before := first.setdefault((*row,), name)) is not name:
            pairs.append((name, before))
    return pairs


def cost(rows: int) -> str:
    """Approximate cost of a diagnosis of this many positions, in words."""
    seconds, gib = _SECONDS * (rows / 1000) ** 2, _GIB_FIXED + _GIB * (rows / 1000) ** 2
    return f"about {duration(seconds)} and {gib:.0f} GiB of memory"


def _groups(data: PositionSet, means: int) -> list[Int[np.ndarray, " rows"]]:
    """Rows to average, in order of measurement: about `means` groups, but at least one for each attitude."""
    count = len(data)
    columns = [np.round(data.alpha_deg, 6), np.round(data.beta_deg, 6)]
    columns += [np.unique(labels, return_inverse=True)[1] for labels in (data.run, data.mount, data.clock) if labels]
    columns += [data.approach] if data.approach is not None else []
    attitude = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)[1].ravel()
    order = np.arange(count) if data.time_s is None else np.argsort(data.time_s, kind="stable")
    repeats = [order[attitude[order] == k] for k in np.unique(attitude)]
    # Rows that differ from their repeats are not averaged.
    away, several = np.zeros((count, 3)), np.zeros(count, bool)
    for rows in repeats:
        away[rows] = np.abs(data.readings[rows] - np.median(data.readings[rows], axis=0))
        several[rows] = len(rows) > 1
    scale = 1.4826 * np.median(away[several], axis=0) if several.any() else np.full(3, np.inf)
    ratio = np.max(away / np.maximum(scale, 1e-12), axis=1)
    worst = np.argsort(-ratio, kind="stable")[:_MOST_ALONE]
    alone = worst[ratio[worst] > _ALONE_FROM]
    repeats = [rest for rows in repeats if len(rest := rows[~np.isin(rows, alone)])]
    room = max(0, means - len(alone) - len(repeats))
    share = room / max(1, count - len(alone) - len(repeats))
    parts = [part for rows in repeats for part in np.array_split(rows, 1 + int((len(rows) - 1) * share))]
    rank = np.argsort(order)
    return sorted([*parts, *alone[:, None]], key=lambda rows: float(rank[rows].mean()))


def _averaged(data: PositionSet, groups: list[np.ndarray], noise_sd: float | None) -> PositionSet:
    """The means of groups of rows, weighted by the sd columns if there are any."""
    count, sizes = len(data), np.array([len(rows) for rows in groups])
    rows, group_of = np.concatenate(groups), np.repeat(np.arange(len(groups)), sizes)
    starts = np.cumsum(sizes) - sizes
    # Correlated noise of dwells does not average like independent noise of their sd columns.
    column_sd = data.weighing_sd if data.recorded_noise is None else None
    sd = np.full((count, 3), noise_sd) if noise_sd is not None else column_sd
    weights = np.ones((count, 3)) if sd is None else 1.0 / sd**2

    def summed(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values[rows], starts, axis=0)

    total = summed(weights)
    readings = summed(weights * data.readings) / total
    sd_of_mean = None if sd is None else 1.0 / np.sqrt(total)
    if sd is None and np.max(sizes[sizes > 1]) > _UNEQUAL * np.min(sizes):
        scatter = np.sum((data.readings[rows] - readings[group_of]) ** 2, axis=0)
        sd_of_mean = np.sqrt(scatter / (count - len(groups))) / np.sqrt(sizes)[:, None]
    names = [data.names[group[0]] for group in groups]
    names = [
        f"{name}..{data.names[rows[-1]]}" if len(rows) > 1 else name for name, rows in zip(names, groups, strict=True)
    ]
    return replace(
        data.chosen(rows[starts]),
        names=tuple(names),
        readings=readings,
        sd=sd_of_mean,
        time_s=None if data.time_s is None else summed(data.time_s) / sizes,
        temperature_degc=None if data.temperature_degc is None else summed(data.temperature_degc) / sizes,
        n=summed(np.ones(count) if data.n is None else data.n),
        recorded_noise=None,
    )


def unfinished(data: PositionSet, error: Exception) -> InputError:
    """The fault of positions whose evaluation ended with an error of the computation: too little memory, or singular
    equations."""
    if isinstance(error, MemoryError):
        return InputError(
            f"{data.source}: not enough memory for {len(data)} positions ({cost(len(data))}); average repeats, or diagnose "
            "parts of the file separately"
        )
    return InputError(
        f"{data.source}: the model cannot be fitted to these readings (singular equations); check angles, axes and units "
        "against the measurement log"
    )


def position_notes(data: PositionSet) -> list[str]:
    """Columns that may have been meant, and rows that look copied, as warnings.

    **Raises:** `InputError` for raw samples.
    """
    if data.of_samples:
        reduced = Path("reduced")
        raise InputError(
            f"{data.source}: {len(data)} rows, but only {counted(data.stretches, 'stretch')} of one position each, so these "
            f"look like raw samples. Reduce them first, then give {reduced / 'positions.csv'}: "
            f"{suggested('reduce', data.source, '--out', reduced)}"
        )
    free = [name for name in KNOWN if name not in (*data.columns, *READINGS)]
    meant = {name: likely_meant(name, free) for name in data.ignored}
    notes = [
        f"column {name} is not used; did you mean {other}? Rename it, or give --columns {other}={name}"
        for name, other in meant.items()
        if other
    ]
    if copies := [f"{name} and {first}" for name, first in copied_positions(data)]:
        listed = shortened(copies, _MOST_COPIES)
        notes.append(f"identical rows: positions {listed}; a copied row is weighted twice: remove it")
    return notes
