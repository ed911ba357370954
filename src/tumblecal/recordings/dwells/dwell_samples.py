"""The samples of each position of a measurement, whatever its source."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan, names_of
from tumblecal.capture.decoding.samples import Floats
from tumblecal.data.parquet import scan_parquet
from tumblecal.data.position_comments import ATTITUDES, UNKNOWN
from tumblecal.data.positions import PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, comments_of, stated_gravity
from tumblecal.ground.numbers_shown import shortened
from tumblecal.recordings.dwells.places import Known, Place, position_set
from tumblecal.recordings.options import KnownContext
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.still.stillness import Stillness


# Fewest samples of a position; positions in a message.
_FEWEST, _SHOWN = 16, 6
_OF_MEANS = ". A table of means needs no reduction: give it to calibrate"


@dataclass(frozen=True)
class DwellSamples:
    """The samples of each position, and the evidence for them.

    - `positions`: a row for each dwell, with its mean, the time of its middle, and its number of samples; no uncertainties.
    - `force`: samples of each dwell, g, shape (n, 3); empty if the source has means only. `temperatures`: of the samples, degC.
    - `time_s`: middle of each dwell in the samples, s, if it is not that of the positions. `rate_hz`: sample rate.
      `recording`: identifier of the recording.
    - `counted`: missing and saturated samples of each dwell, and a fault of its rate, as arguments of `check_dwell`.
    - `entries`, `dwell_entries`: entries of reduction.json, for all dwells and for each.
    - `files`: as given. `read`: the recordings. `warnings`: lines for each source. `lines`: how the positions were found.
    - `stillness`: intervals at rest, if they were searched.
    """

    positions: PositionSet
    force: Sequence[Floats] = ()
    rate_hz: float = np.nan
    recording: str = ""
    temperatures: Sequence[Floats] | None = None
    time_s: Floats | None = None
    counted: Sequence[Mapping[str, Any]] = ()
    entries: Mapping[str, object] = field(default_factory=dict)
    dwell_entries: Sequence[Mapping[str, object]] = ()
    files: tuple[Path, ...] = ()
    read: tuple[Recording, ...] = ()
    warnings: tuple[tuple[str, list[str]], ...] = ()
    lines: tuple[str, ...] = ()
    stillness: Stillness | None = None

    @property
    def still_s(self) -> float | None:
        """Total length of the dwells, s; None for means."""
        return sum(map(len, self.force)) / self.rate_hz if self.force else None


def require_samples(
    source: str, places: Sequence[Place], dwells: Sequence, fewest: int = _FEWEST, remedy: str = _OF_MEANS
) -> None:
    """Check that every dwell has enough samples (rows) for a mean.

    **Raises:** `InputError` with the dwells that have too few samples.
    """
    names = names_of([place.position for place in places])
    if few := [f"{name} ({len(rows)})" for name, rows in zip(names, dwells, strict=True) if len(rows) < fewest]:
        raise InputError(
            f"{source}: too few samples at position {shortened(few, _SHOWN)}; {fewest} are needed at each{remedy}"
        )


def dwell_samples(
    source: str,
    places: Sequence[Place],
    force: Sequence[Floats],
    rate_hz: float,
    comments: Mapping[str, str],
    known: Known = (KnownContext(), None),
    *,
    temperatures: Sequence[Floats] | None = None,
    fewest: int = _FEWEST,
    remedy: str = _OF_MEANS,
    columns: Mapping[str, Any],
    **evidence: Any,
) -> DwellSamples:
    """The dwells at these places, with the means of their samples.

    **Arguments:**

    - `source`: name for faults. `force`, `rate_hz`, `temperatures`, `evidence`: as of `DwellSamples`.
    - `comments`, `known`: as of `position_set`; `columns`: further columns of the positions, instead of those of the samples.
    - `fewest`: samples of a dwell; `remedy`: if there are fewer.

    **Raises:** `InputError` with the dwells that have too few samples.
    """
    require_samples(source, places, force, fewest, remedy)
    known_degc = [part[np.isfinite(part)] for part in temperatures or ()]
    complete = known_degc and all(map(len, known_degc))
    of_samples = {
        "temperature_degc": np.array([part.mean() for part in known_degc]) if complete else None,
        "n": np.array([len(dwell) for dwell in force], float),
    }
    means = np.array([dwell.mean(0) for dwell in force])
    positions = position_set(source, means, places, comments, known, **of_samples | dict(columns))
    return DwellSamples(positions, force, rate_hz, temperatures=temperatures, **evidence)


def stated_comments(samples: Path, source: Path, plan: CapturePlan | None, *, hand_held: bool) -> dict[str, str]:
    """The comments of the positions; gravity as stated, otherwise from the plan, otherwise standard for m/s^2."""
    table, _, stored = scan_parquet(samples, check=False)
    in_ms2 = "ax_ms2" in table.collect_schema()
    gravity = plan.site.gravity if plan and not plan.site.gravity.assumed else None
    gravity = stated_gravity(stored, str(source)) or gravity or (STANDARD if in_ms2 else None)
    stated = {key: value for key, value in stored.items() if key not in ("rate_hz", "imported_from")}
    stated |= {"reduced_from": source.name} | (comments_of(gravity) if gravity else {})
    return stated | ({ATTITUDES: UNKNOWN} if hand_held else {})
