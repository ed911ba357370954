"""What `tumblecal reduce` prints: the means with their sd, what is unusual, the noise of the axes."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from tumblecal.data.positions import PositionSet
from tumblecal.ground.axes import AXES
from tumblecal.ground.counted import shortened
from tumblecal.noise.dwell_sd import white_sd
from tumblecal.recordings.reduction import Reduction
from tumblecal.show.narrow import print_table
from tumblecal.show.tables import Table


# A terminal narrower than this shows no sd / sqrt(n).
_NARROW = 72
_SHOWN = 8


def print_reduction(reduction: Reduction) -> None:
    """Print a reduction."""
    console, data, dwells = Console(), reduction.data, reduction.dwells.force
    print_table(console, _means(data, dwells, both=console.width >= _NARROW))
    for words in unusual_words(reduction):
        console.print(words, highlight=False, markup=False)
    for change in reduction.within:
        console.print(change.words(), highlight=False, markup=False)
    dwell_s = max(len(dwell) for dwell in dwells) / reduction.dwells.rate_hz
    assert reduction.noise is not None
    for axis, words in zip(AXES, reduction.noise.reported.words(dwell_s), strict=True):
        console.print(f"noise {axis}: {words}", highlight=False)


def unusual_words(reduction: Reduction) -> Iterator[str]:
    """What the checks of the dwells found that is unusual, a line for each position, or for all with the same findings."""
    positions: dict[str, list[str]] = {}
    for name, check in zip(reduction.data.names, reduction.checks, strict=True):
        if check.warnings:
            positions.setdefault("; ".join(check.warnings), []).append(name)
    for words, names in positions.items():
        yield f"{shortened(names, _SHOWN)}: {words}"


def _means(data: PositionSet, dwells: Sequence[NDArray[np.float64]], *, both: bool) -> Table:
    """A row for each axis; `both`: with sd / sqrt(n)."""
    assert data.sd is not None
    rows = []
    for k, (name, dwell) in enumerate(zip(data.names, dwells, strict=True)):
        place = [name, f"{data.alpha_deg[k]:g}", f"{data.beta_deg[k]:g}", str(len(dwell))]
        for axis, (mean, sd, white) in enumerate(zip(data.readings[k], data.sd[k], white_sd(dwell), strict=True)):
            numbers = [f"{mean * 1e3:+.3f}", f"{1e6 * sd:.1f}", *([f"{1e6 * white:.1f}"] if both else [])]
            rows.append([*(place if not axis else [""] * 4), AXES[axis], *numbers])
    titles = ["position", "alpha", "beta", "n", "axis", "mean\nmg", "its sd\nug", *(["sd/sqrt(n)\nug"] if both else [])]
    return Table(titles, rows)
