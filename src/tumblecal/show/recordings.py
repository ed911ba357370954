"""Recordings and their reduction for people: lines and tables of `import`, `reduce`, `thermal`, `check` and `apply`."""

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from tumblecal.ground.axes import AXES
from tumblecal.ground.gravity import unit_in_g
from tumblecal.ground.numbers_shown import shortened
from tumblecal.show.tables import Table
from tumblecal.show.words import Words, words_of


if TYPE_CHECKING:
    from tumblecal.recordings.dwells.dwell_samples import DwellSamples
    from tumblecal.recordings.recording import Recording
    from tumblecal.recordings.reduction import Reduction

_LAYOUT = ("format", "columns", "assumptions")
_MOST_NAMES = 8


def import_lines(recording: "Recording") -> list[str]:
    """What was found, and by what evidence, as a table; below it the assumptions, with the options that override them."""
    words = words_of("recording", r=recording)
    others = [[name, line] for name in ("gaps", "repeats", "damage") for line in words.lines(name) or ["none"]]
    items = [*words.blocks["items"], *others, *words.blocks["temperature"]]
    # The last cell of an item may be long.
    widths = [max(len(item[k]) for item in items if k + 1 < len(item)) for k in range(3)]
    table = [
        "  ".join([*(cell.ljust(width) for cell, width in zip(item[:-1], widths, strict=False)), item[-1]])
        for item in items
    ]
    return [*words.lines("format"), *words.lines("tables"), *table, *words.lines("assumptions")]


def layout_lines(recordings: Sequence["Recording"]) -> Iterator[str]:
    """The layout of the first recording, then what differs in others, except the mean size."""
    known: set[str] = set()
    for one in recordings:
        words = words_of("recording", r=one)
        entries = [cells for block in _LAYOUT for cells in words.blocks[block]]
        prefix = f"{one.path}: " if known else ""
        yield from (prefix + ", ".join(cells) for cells in entries if cells[0] not in known)
        known = known or {cells[0] for cells in entries}


def left_out_lines(recording: "Recording") -> list[str]:
    """Number of rows without a complete reading, and the first of them; nothing if there are none."""
    return words_of("recording", r=recording).lines("left out")


def words_of_reduction(dwells: "DwellSamples") -> Words:
    """The words of dwells: `files`, `intervals`, `judged`, `steps` and `rejected`."""
    still = dwells.stillness
    steps_mg = 1e3 * max(still.coarse.values(), default=0) * unit_in_g(still.blocks.unit, None) if still else 0
    return words_of("reduction", d=dwells, steps_mg=steps_mg)


def reduction_lines(dwells: "DwellSamples") -> Iterator[str]:
    """The recordings, their intervals at rest, and how the positions were found."""
    yield from layout_lines(dwells.read)
    several = len(dwells.read) > 1
    for one in dwells.read if dwells.force else ():
        words, prefix = words_of("recording", r=one), f"{one.path}: " if several else ""
        blocks = ("left out", "gaps") if several else ("rate", "gaps", "left out", "temperature")
        yield from (prefix + " ".join(cells) for block in blocks for cells in words.blocks[block])
    words = words_of_reduction(dwells)
    yield from (line for block in words.blocks for line in words.lines(block))
    yield from dwells.lines


def interval_lines(dwells: "DwellSamples") -> list[str]:
    """How attitudes were found: the number of intervals at rest, and those that were rejected."""
    words = words_of_reduction(dwells)
    return [*dwells.lines, *(line for block in ("intervals", "steps", "rejected") for line in words.lines(block))]


def unusual_lines(reduction: "Reduction") -> list[str]:
    """What the checks of the dwells found that is unusual."""
    # Tables of means have no checks.
    checks = zip(reduction.data.names, reduction.checks, strict=bool(reduction.checks))
    return grouped_lines((name, "; ".join(check.warnings)) for name, check in checks if check.warnings)


def grouped_lines(findings: Iterable[Sequence[str]]) -> list[str]:
    """Names and words as lines, equal words as one line with all their names."""
    names: dict[str, list[str]] = {}
    for name, words in findings:
        names.setdefault(words, []).append(name)
    return [f"{shortened(each, _MOST_NAMES)}: {words}" for words, each in names.items()]


def noise_lines(reduction: "Reduction") -> list[str]:
    """The noise of the axes, and changes that all dwells share."""
    assert reduction.noise is not None
    dwell_s = max(map(len, reduction.dwells.force)) / reduction.dwells.rate_hz
    noise = zip(AXES, reduction.noise.reported.words(dwell_s), strict=True)
    return [*(change.words() for change in reduction.within), *(f"noise {axis}: {words}" for axis, words in noise)]


def print_means(reduction: "Reduction") -> None:
    """Print the means of samples with their standard deviations, a row for each axis."""
    from rich.console import Console

    from tumblecal.noise.dwell_sd import white_sd
    from tumblecal.show.narrow import print_table

    data, rows = reduction.data, list[list[str]]()
    assert data.sd is not None
    for k, (name, dwell) in enumerate(zip(data.names, reduction.dwells.force, strict=True)):
        place = [name, f"{data.alpha_deg[k]:g}", f"{data.beta_deg[k]:g}", str(len(dwell))]
        for axis, mean, sd, white in zip(AXES, data.readings[k], data.sd[k], white_sd(dwell), strict=True):
            rows.append([*place, axis, f"{mean * 1e3:+.3f}", f"{1e6 * sd:.1f}", f"{1e6 * white:.1f}"])
            place = [""] * 4
    titles = ["position", "alpha", "beta", "n", "axis", "mean\nmg", "its sd\nug", "sd/sqrt(n)\nug"]
    print_table(Console(), Table(titles, rows))
