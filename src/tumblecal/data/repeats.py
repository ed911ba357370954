"""Large data sets in bounds: repeats of a position averaged, the rest said in time and memory or refused.

The work of a diagnosis grows with the square of its positions. Rows of the same attitude, run, mounting and approach that
follow one another differ by noise alone, so their mean says of every effect what they say; what is slow (drift,
temperature) is kept by averaging only a few at a time. A row that differs from its repeats is left by itself: exchanged,
mislabelled and outlying positions stay visible by name.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from tumblecal.data import PositionSet
from tumblecal.ground.errors import InputError


# Positions that are always taken one by one; means that are made of more; what is refused when it cannot be averaged.
MOST_ROWS, MEANS, REFUSED = 400, 240, 1000
# Time and memory of 1,000 positions on one core (benchmarks/size_in_rows.py); both grow with the square.
_SECONDS, _GIB_FIXED, _GIB = 55.0, 0.6, 1.5
# A reading further than this (robust sd) from the median of its repeats is left by itself, the worst ones.
_ALONE_FROM, _MOST_ALONE = 6.0, 20
# Where the means are of such unequal numbers of rows, their sd has to be stated: from the scatter of the repeats.
_UNEQUAL = 2.0


@dataclass(frozen=True)
class InBounds:
    """Positions to be diagnosed, the sd of every reading where that is stated apart (g), and in words what was done."""

    data: PositionSet
    noise_sd: float | None
    words: str = ""


def in_bounds(data: PositionSet, noise_sd: float | None, most: int | None = None, *, sampled: bool = False) -> InBounds:
    """At most `most` positions: repeats are averaged where there are more.

    **Arguments:**

    - `noise_sd`: stated sd of every reading, g.
    - `most`: given by the user; then more are neither averaged into nor taken.
    - `sampled`: whether raw samples belong to the positions, which are then not averaged.

    **Raises:** `InputError` for more positions than that, after averaging, with what they would cost.
    """
    wanted = MOST_ROWS if most is None else most
    if len(data) <= wanted:
        return InBounds(data, noise_sd)
    groups = [] if sampled or data.hand_held else _groups(data, min(MEANS, wanted))
    if groups and len(groups) <= wanted:
        averaged = _averaged(data, groups, noise_sd)
        sizes = sorted({len(rows) for rows in groups})
        words = (
            f"{len(data)} rows are diagnosed as {len(groups)} means of up to {sizes[-1]} repeats each (same attitude, run and "
            f"mounting, one after the other); --max-rows {len(data)} takes each by itself ({cost(len(data))})."
        )
        if data.recorded_noise is not None and noise_sd is None:
            words += (
                " The recording's noise model is not one of such means: their noise counts as unknown and independent."
            )
        return InBounds(averaged, None, words)
    if len(data) > (REFUSED if most is None else most):
        raise InputError(
            f"{data.source}: {len(data)} positions, which cannot be averaged to {wanted} (rows of the same attitude, run and "
            f"mounting can): one by one they would take {cost(len(data))}. Diagnose runs or parts apart, or allow it with "
            f"--max-rows {len(data)}"
        )
    return InBounds(data, noise_sd, f"{len(data)} positions: this takes {cost(len(data))}.")


def cost(rows: int) -> str:
    """About what a diagnosis of so many positions takes, in words."""
    seconds, gib = _SECONDS * (rows / 1000) ** 2, _GIB_FIXED + _GIB * (rows / 1000) ** 2
    time = (
        f"{seconds:.0f} s"
        if seconds < 120
        else f"{seconds / 60:.0f} min"
        if seconds < 7200
        else f"{seconds / 3600:.0f} h"
    )
    return f"about {time} and {gib:.0f} GiB of memory"


def _groups(data: PositionSet, means: int) -> list[Int[np.ndarray, " rows"]]:
    """Rows that are averaged, in measuring order: about `means` groups, but no fewer than there are attitudes."""
    count = len(data)
    columns = [np.round(data.alpha_deg, 6), np.round(data.beta_deg, 6)]
    columns += [np.unique(labels, return_inverse=True)[1] for labels in (data.run, data.mount, data.clock) if labels]
    columns += [data.approach] if data.approach is not None else []
    _, attitude = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)
    order = np.arange(count) if data.time_s is None else np.argsort(data.time_s, kind="stable")
    attitude = attitude.ravel()
    repeats = [order[attitude[order] == k] for k in range(int(attitude.max()) + 1)] if count else []
    alone = _alone(data.readings, repeats)
    repeats = [rest for rows in repeats if len(rest := rows[~np.isin(rows, alone)])]
    room = max(0, means - len(alone) - len(repeats))
    share = room / max(1, count - len(alone) - len(repeats))
    parts = [part for rows in repeats for part in np.array_split(rows, 1 + int((len(rows) - 1) * share))]
    rank = np.empty(count)
    rank[order] = np.arange(count)
    return sorted([*parts, *(np.array([row]) for row in alone)], key=lambda rows: float(rank[rows].mean()))


def _alone(readings: Float[np.ndarray, "rows 3"], repeats: list[np.ndarray]) -> list[int]:
    """Rows that differ from their repeats."""
    away = np.zeros_like(readings)
    for rows in repeats:
        away[rows] = np.abs(readings[rows] - np.median(readings[rows], axis=0))
    several = np.concatenate([rows for rows in repeats if len(rows) > 1] or [np.zeros(0, int)])
    if not len(several):
        return []
    scale = 1.4826 * np.median(away[several], axis=0)
    ratio = np.max(away / np.maximum(scale, 1e-12), axis=1)
    worst = np.argsort(-ratio, kind="stable")[:_MOST_ALONE]
    return [int(row) for row in worst if ratio[row] > _ALONE_FROM]


def _averaged(data: PositionSet, groups: list[np.ndarray], noise_sd: float | None) -> PositionSet:
    """The means of groups of rows, weighted by the sd columns where there are any."""
    count, sizes = len(data), np.array([len(rows) for rows in groups])
    rows = np.concatenate(groups)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    # What dwells have in common does not average down as their sd columns would.
    own = data.weighing_sd if data.recorded_noise is None else None
    sd = np.full((count, 3), noise_sd) if noise_sd is not None else own
    weights = np.ones((count, 3)) if sd is None else 1.0 / sd**2

    def summed(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values[rows], starts, axis=0)

    total = summed(weights)
    readings = summed(weights * data.readings) / total
    if sd is None and np.max(sizes[sizes > 1]) > _UNEQUAL * np.min(sizes):
        scatter = summed((data.readings - readings[np.repeat(np.arange(len(groups)), sizes)[np.argsort(rows)]]) ** 2)
        sd_of_mean = np.sqrt(scatter.sum(axis=0) / (count - len(groups))) / np.sqrt(sizes)[:, None]
    else:
        sd_of_mean = None if sd is None else 1.0 / np.sqrt(total)

    def mean(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else summed(values) / sizes

    first = data.chosen(rows[starts])
    return PositionSet(
        names=tuple(
            data.names[own[0]] if len(own) == 1 else f"{data.names[own[0]]}..{data.names[own[-1]]}" for own in groups
        ),
        alpha_deg=first.alpha_deg,
        beta_deg=first.beta_deg,
        readings=readings,
        sd=sd_of_mean,
        run=first.run,
        mount=first.mount,
        clock=first.clock,
        time_s=mean(data.time_s),
        temperature_degc=mean(data.temperature_degc),
        approach=first.approach,
        n=summed(np.ones(count) if data.n is None else data.n),
        comments=data.comments,
        source=data.source,
    )
