"""Means of dwells with standard deviations, checks and noise, for every kind of source, and their files.

The standard deviation of a mean comes from the coloured noise: an average over the noise models that the dwells allow, with
the closed form for means. sd / sqrt(n) would be too small. The noise that neighbouring means share is written with it.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tumblecal.capture.decoding.samples import Floats
from tumblecal.data.files import write_positions
from tumblecal.data.position_comments import NOISE_MODEL
from tumblecal.data.positions import PositionSet
from tumblecal.ground.axes import AXES
from tumblecal.noise.allan import averaging_factors, overlapping_allan
from tumblecal.noise.allan_fit import quantisation_and_misfit
from tumblecal.noise.dwell_fit import ordinary_dwells
from tumblecal.noise.dwell_sd import sd_of_means
from tumblecal.noise.recorded import RecordedNoise
from tumblecal.noise.within_dwells import WithinDwells, within_dwells_comments, without_common_change
from tumblecal.recordings.dwells.dwell_checks import DwellChecks, check_dwell, require_axes_answer
from tumblecal.recordings.dwells.dwell_samples import DwellSamples
from tumblecal.recordings.reduction_record import AxisRecord, PositionRecord, ReductionRecord


@dataclass(frozen=True)
class Reduction:
    """Positions with their uncertainties.

    - `data`: the means. `dwells`: their samples, with the evidence.
    - `checks`: of each dwell. `noise`: that of the samples; None if the source has means only.
    - `within`: changes that all dwells share. `quiet`: the samples of each dwell without these, with the same mean.
    """

    data: PositionSet
    dwells: DwellSamples
    checks: Sequence[DwellChecks] = ()
    noise: RecordedNoise | None = None
    within: tuple[WithinDwells, ...] = ()
    quiet: Sequence[Floats] = ()


def reduction_of(dwells: DwellSamples) -> Reduction:
    """The means of dwells with their standard deviations, noise and checks; those of a source of means as they are.

    **Raises:** `InputError` for an axis that does not respond to gravity.
    """
    data, rate_hz = dwells.positions, dwells.rate_hz
    if not dwells.force:
        return Reduction(data, dwells)
    time_s = data.time_s if dwells.time_s is None else dwells.time_s
    assert time_s is not None
    require_axes_answer(data.source, dwells.force)
    # A change that all dwells share is not noise: it is removed before the noise is estimated.
    quiet, within = without_common_change(dwells.force, rate_hz, dwells.temperatures)
    noise = RecordedNoise.of(quiet, rate_hz, float(np.ptp(time_s)), dwells.recording)
    sd, text = sd_of_means(noise, quiet, time_s), noise.text()
    numbers = dwells.counted or [{}] * len(quiet)
    checks = [check_dwell(dwell, rate_hz, row, **counts) for dwell, row, counts in zip(quiet, sd, numbers, strict=True)]
    comments = data.comments | {NOISE_MODEL: text} | within_dwells_comments(within)
    data = replace(data, sd=sd, recorded_noise=(text,) * len(data), comments=comments)
    return Reduction(data, dwells, checks, noise, within, quiet)


def write_reduction(reduction: Reduction, folder: Path) -> list[Path]:
    """Write positions.csv, positions.parquet and, unless the source has means only, reduction.json into a folder."""
    paths = [folder / "positions.csv", folder / "positions.parquet"]
    for path in paths:
        write_positions(path, reduction.data)
    data, dwells, noise = reduction.data, reduction.dwells, reduction.noise
    if noise is None or data.sd is None:
        return paths
    # Noise coefficients and Allan deviation of each axis.
    factors = averaging_factors(max(map(len, reduction.quiet)), per_octave=2)
    calm, reported, axes = ordinary_dwells(list(reduction.quiet)), noise.reported, {}
    for axis, (letter, coefficients) in enumerate(zip(AXES, reported.coefficients(), strict=True)):
        allan = overlapping_allan([force[:, axis] for force in calm], dwells.rate_hz, factors)
        axes[letter] = AxisRecord.of(allan, noise=coefficients | quantisation_and_misfit(allan, reported, axis))
    more = dwells.dwell_entries or [{}] * len(data)
    positions = [
        PositionRecord.model_validate(
            dict(entries)
            | {"name": name, "n": len(force), "mean_g": force.mean(0), "sd_of_mean_g": sd, "checks": checks}
            | {"batch_means_sd_g": force, "white_noise_sd_g": force}
        )
        for name, entries, force, sd, checks in zip(
            data.names, more, reduction.quiet, data.sd, reduction.checks, strict=True
        )
    ]
    record = ReductionRecord.model_validate(
        dict(dwells.entries)
        | {"rate_hz": dwells.rate_hz, "noise_model": json.loads(noise.text())}
        | {"within_dwells": reduction.within, "axes": axes, "positions": positions}
    )
    path = folder / "reduction.json"
    record.write(path)
    return [*paths, path]
