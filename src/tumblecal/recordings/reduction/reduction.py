"""Means of dwells with standard deviations, checks and noise, for every kind of source, and their files.

The standard deviation of a mean comes from the coloured noise: an average over the noise models that the dwells allow, with
the closed form for means. sd / sqrt(n) would be too small. The noise that neighbouring means share is written with it.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.files import write_positions
from tumblecal.data.positions import PositionSet
from tumblecal.ground.atomic import write_text
from tumblecal.ground.axes import AXES
from tumblecal.noise.allan import averaging_factors, overlapping_allan
from tumblecal.noise.allan_fit import quantisation_and_misfit
from tumblecal.noise.dwell_fit import ordinary_dwells
from tumblecal.noise.dwell_sd import batch_means_sd, sd_of_means, white_sd
from tumblecal.noise.recorded import NOISE_MODEL, RecordedNoise
from tumblecal.noise.within_dwells import WithinDwells, within_dwells_comments, without_common_change
from tumblecal.recordings.reduction.axis_checks import require_axes_answer
from tumblecal.recordings.reduction.dwell_checks import DwellChecks, check_dwell


@dataclass(frozen=True)
class Reduction:
    """Means of dwells, with the samples and the checks of each, and the noise that gives their standard deviations.

    `entries` and `dwell_entries` are further entries of reduction.json, for all dwells and for each. `within`: changes that all
    dwells share; `noise_samples`: the samples of each dwell without these changes, with the same mean.
    """

    data: PositionSet
    sd_of_mean: NDArray[np.float64]
    dwells: Sequence[NDArray[np.float64]]
    checks: Sequence[DwellChecks]
    recorded: RecordedNoise
    rate_hz: float
    entries: Mapping[str, object]
    dwell_entries: Sequence[Mapping[str, object]]
    within: tuple[WithinDwells, ...]
    noise_samples: Sequence[NDArray[np.float64]]

    @property
    def damage(self) -> list[str]:
        """Missing or changed parts of the source, one line each."""
        found = self.entries.get("damage")
        return list(map(str, found)) if isinstance(found, list) else []


def reduction_of(
    data: PositionSet,
    dwells: Sequence[NDArray[np.float64]],
    rate_hz: float,
    recording: str,
    *,
    entries: Mapping[str, object] | None = None,
    dwell_entries: Sequence[Mapping[str, object]] = (),
    counted: Sequence[Mapping[str, Any]] = (),
    temperatures: Sequence[NDArray[np.float64]] | None = None,
) -> Reduction:
    """Means with their standard deviations, noise and checks.

    **Arguments:**

    - `data`: the positions, with the middle of each dwell as time; standard deviations and noise are added to it.
    - `dwells`: the samples of each dwell, g, shape (n, 3). `recording`: identifier of the recording.
    - `entries`, `dwell_entries`: as for `Reduction`; by default only the source.
    - `counted`: counts of missing samples of each dwell, and its fault of the rate, for `check_dwell`.
    - `temperatures`: temperatures of each dwell's samples, degC, if recorded.

    **Raises:** `InputError` for an axis that does not respond to gravity.
    """
    assert data.time_s is not None
    require_axes_answer(data.source, dwells)
    # A change that all dwells share is not noise: it is removed before the noise is estimated.
    quiet, within = without_common_change(dwells, rate_hz, temperatures)
    recorded = RecordedNoise.of(quiet, rate_hz, float(np.ptp(data.time_s)), recording)
    sd = sd_of_means(recorded, quiet, data.time_s)
    counted, nothing = counted or [{}] * len(dwells), [{}] * len(dwells)
    checks = [check_dwell(dwell, rate_hz, row, **counts) for dwell, row, counts in zip(quiet, sd, counted, strict=True)]
    noise = recorded.text()
    comments = data.comments | {NOISE_MODEL: noise} | within_dwells_comments(within)
    whole = replace(data, sd=sd, recorded_noise=(noise,) * len(dwells), comments=comments)
    entries = {"source": data.source} if entries is None else entries
    return Reduction(whole, sd, dwells, checks, recorded, rate_hz, entries, dwell_entries or nothing, within, quiet)


def write_reduction(reduction: Reduction, folder: Path, more: Mapping[str, object] | None = None) -> list[Path]:
    """Write positions.csv, positions.parquet and reduction.json, with `more` in it, into a folder."""
    paths = [folder / "positions.csv", folder / "positions.parquet", folder / "reduction.json"]
    write_positions(paths[0], reduction.data)
    write_positions(paths[1], reduction.data)
    r = reduction
    content = {
        "schema": "tumblecal.reduction/1",
        "rate_hz": r.rate_hz,
        "noise_model": json.loads(r.recorded.text()),
        "within_dwells": [change.as_dict() | {"words": change.words()} for change in r.within],
        **r.entries,
        **(more or {}),
        "axes": _axes(r),
        "positions": [
            {"name": name, **of_dwell, **_of_dwell(dwell, sd, checks)}
            for name, of_dwell, dwell, sd, checks in zip(
                r.data.names, r.dwell_entries, r.noise_samples, r.sd_of_mean, r.checks, strict=True
            )
        ],
    }
    write_text(paths[2], json.dumps(content, indent=1) + "\n")
    return paths


def _axes(reduction: Reduction) -> dict:
    """Noise coefficients and Allan deviation of each axis, for a file."""
    factors = averaging_factors(max(map(len, reduction.dwells)), per_octave=2)
    calm, reported = ordinary_dwells(list(reduction.noise_samples)), reduction.recorded.reported
    axes = {}
    for axis, (letter, coefficients) in enumerate(zip(AXES, reported.coefficients(), strict=True)):
        allan = overlapping_allan([force[:, axis] for force in calm], reduction.rate_hz, factors)
        axes[letter] = {
            "noise": {**coefficients, **quantisation_and_misfit(allan, reported, axis)},
            "allan": {
                "tau_s": allan.tau_s.tolist(),
                "deviation_g": allan.deviation.tolist(),
                "low_g": allan.low.tolist(),
                "high_g": allan.high.tolist(),
            },
        }
    return axes


def _of_dwell(force: NDArray[np.float64], sd: NDArray[np.float64], checks: DwellChecks) -> dict:
    """Mean, its standard deviation in three ways, and the checks of a dwell, for a file."""
    return {
        "n": len(force),
        "mean_g": force.mean(0).tolist(),
        "sd_of_mean_g": sd.tolist(),
        "batch_means_sd_g": batch_means_sd(force).tolist(),
        "white_noise_sd_g": white_sd(force).tolist(),
        "checks": checks.as_dict(),
    }
