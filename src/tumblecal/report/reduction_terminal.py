"""What `tumblecal reduce` prints: the means with their sd, what is unusual, the noise of the axes."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table

from tumblecal.capture.reduction.reduction import Reduction
from tumblecal.data.positions import PositionSet
from tumblecal.ground.axes import AXES
from tumblecal.noise.dwell_sd import white_sd


# A terminal as wide as this shows a position a row; a narrower one an axis a row, the narrowest without sd / sqrt(n).
_WIDE, _NARROW = 110, 72
_SHOWN = 8


def print_reduction(reduction: Reduction) -> None:
    """Print a reduction."""
    console, data, dwells = Console(), reduction.data, reduction.dwells
    if console.width >= _WIDE:
        console.print(_by_position(data, dwells))
    else:
        console.print(_by_axis(data, dwells, both=console.width >= _NARROW))
    for words in unusual_words(reduction):
        console.print(words, highlight=False, markup=False)
    for change in reduction.within:
        console.print(change.words(), highlight=False, markup=False)
    dwell_s = max(len(dwell) for dwell in dwells) / reduction.rate_hz
    for axis, words in zip(AXES, reduction.recorded.reported.words(dwell_s), strict=True):
        console.print(f"noise {axis}: {words}", highlight=False)


def unusual_words(reduction: Reduction) -> Iterator[str]:
    """What the checks of the dwells found that is unusual, a line for each position, or for all with the same findings."""
    positions: dict[str, list[str]] = {}
    for name, check in zip(reduction.data.names, reduction.checks, strict=True):
        if check.warnings:
            positions.setdefault("; ".join(check.warnings), []).append(name)
    for words, names in positions.items():
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        yield f"{', '.join(names[:_SHOWN])}{more}: {words}"


def _sizes(data: PositionSet, dwells: Sequence[NDArray[np.float64]]) -> tuple[NDArray, NDArray]:
    """Sd of the means, and sd / sqrt(n), ug."""
    assert data.sd is not None
    return 1e6 * data.sd, 1e6 * np.stack([white_sd(dwell) for dwell in dwells])


def _by_position(data: PositionSet, dwells: Sequence[NDArray[np.float64]]) -> Table:
    titles = ("position", "alpha", "beta", "n", "x mg", "y mg", "z mg", "sd of the mean ug", "sd/sqrt(n) ug")
    sd, white = _sizes(data, dwells)
    rows = []
    for k, where in enumerate(_places(data, dwells)):
        means = (f"{mean * 1e3:+.3f}" for mean in data.readings[k])
        rows.append([*where, *means, *(" ".join(f"{size:.1f}" for size in row[k]) for row in (sd, white))])
    return _filled(Table(box=box.SIMPLE), titles, rows)


def _by_axis(data: PositionSet, dwells: Sequence[NDArray[np.float64]], *, both: bool) -> Table:
    titles = ("position", "alpha", "beta", "n", "axis", "mean\nmg", "its sd\nug", *(["sd/sqrt(n)\nug"] if both else []))
    sd, white = _sizes(data, dwells)
    rows = []
    for k, where in enumerate(_places(data, dwells)):
        for axis, letter in enumerate(AXES):
            numbers = [f"{data.readings[k, axis] * 1e3:+.3f}", f"{sd[k, axis]:.1f}"]
            numbers += [f"{white[k, axis]:.1f}"] if both else []
            rows.append([*(where if not axis else ("",) * 4), letter, *numbers])
    return _filled(Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0)), titles, rows)


def _places(data: PositionSet, dwells: Sequence[NDArray[np.float64]]) -> list[tuple[str, str, str, str]]:
    settings = zip(data.names, data.alpha_deg, data.beta_deg, dwells, strict=True)
    return [(name, f"{alpha:g}", f"{beta:g}", str(len(dwell))) for name, alpha, beta, dwell in settings]


def _filled(table: Table, titles: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """The table with these rows; to rich they are one, which it lays out in a fifth of the time."""
    for title in titles:
        table.add_column(title, justify="right", no_wrap=True)
    table.add_row(*("\n".join(column) for column in zip(*rows, strict=True)))
    return table
