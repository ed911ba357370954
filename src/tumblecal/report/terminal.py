"""Terminal output of `tumblecal calibrate`: estimates of all methods, quality of the fit, poorly determined parameters."""

from collections.abc import Iterator

import numpy as np
from rich.console import Console

from tumblecal.estimation.curves_of_fit import reported
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.noise_level import ContradictedLevel
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.numbers_shown import rounded
from tumblecal.ground.units import shown
from tumblecal.lab.judgements import remedy_words
from tumblecal.report.calibration_words import (
    TITLES,
    methods_words,
    noise_words,
    notes,
)
from tumblecal.report.result_file import strong_correlations
from tumblecal.show.narrow import print_table, print_words
from tumblecal.show.tables import Table


def print_calibration(calibrated: Calibrated, console: Console | None = None) -> None:
    """Print a calibration."""
    console = console or Console()
    exact = calibrated.exact
    print_words(console, "")
    print_words(console, exact.data.source, style="bold")
    _print_table(calibrated, console)
    for line in [
        f"use: {calibrated.use.words}",
        *(judgement.words for judgement in calibrated.judgements),
        *(f"IMPLAUSIBLE: {words}" for words in implausible_words(calibrated.implausible)),
        *(f"corrected: {setup_error.description}" for setup_error in calibrated.setup_errors),
        *notes(calibrated),
        *quality(exact, calibrated.level),
        *methods_words(calibrated),
        *weaknesses(exact),
        *_only_exact(calibrated),
    ]:
        print_words(console, line)


def _print_table(calibrated: Calibrated, console: Console) -> None:
    others = {name: reported(fit) for name, fit in calibrated.fits.items() if name != "exact"}
    header = ["parameter", "value", "sd", "unit", *(f"{TITLES[name]}\ndiff / sd" for name in others)]
    exact, rows = reported(calibrated.exact), []
    for name, unit, value, sd in zip(exact.names, exact.units, exact.values.tolist(), exact.sd.tolist(), strict=True):
        unit, factor = shown(unit)
        # Four decimals suffice for parameters, not for coefficients of powers of the temperature.
        cells = (
            [f"{value * factor:.4f}", f"{sd * factor:.4f}"] if "/" not in name else rounded(value * factor, sd * factor)
        )
        cells = [name, *cells, unit]
        for other in others.values():
            if name in other.names:
                difference = (other.values[other.names.index(name)] - value) / sd
                cells.append(f"{difference:+.3f}" if abs(difference) < 100 else f"{difference:+.3g}")
            else:
                cells.append("-")
        rows.append(cells)
    print_table(console, Table(header, rows, text=(0, 3)))


def quality(result: Fit, level: ContradictedLevel | None = None) -> list[str]:
    """Quality of the fit in words; `level`: the stated noise level, if the residuals contradict it."""
    rms = np.sqrt(np.mean(result.residuals**2)) * 1e3
    lines = [
        f"fit: {result.message}; {result.residuals.size} readings, {len(result.names)} parameters, {result.dof} degrees "
        f"of freedom",
        f"residuals: rms {rms:.4f} mg, from {result.residuals.min() * 1e3:+.3f} to {result.residuals.max() * 1e3:+.3f} mg"
        f" (measured - predicted)",
    ]
    unlisted = len(result.chain.of_positions)
    if unlisted:
        lines.append(
            f"{unlisted} of the parameters belong to one position each (its attitude); they are listed in result.json"
        )
    lines += filter(None, [noise_words(result, level)])
    if not result.code.good:
        lines.insert(0, f"WARNING: the exact fit did not converge; do not use its values. {result.message}")
    return lines


def weaknesses(result: Fit) -> list[str]:
    """Poorly determined combinations and strong correlations in words."""
    seen = result.identifiability
    lines = []
    for direction in seen.weak if seen else ():
        lines.append(
            f"poorly determined combination: {direction.words} (highly correlated; uncertainty {direction.sd_ratio:.0f} times "
            "the median)"
        )
    pairs = [f"{p['first']} with {p['second']} {p['correlation']:+.3f}" for p in strong_correlations(result)[:6]]
    if pairs:
        lines.append(f"correlations above 0.9: {'; '.join(pairs)}")
    if remedy := remedy_words(result):
        lines.append(f"To fix this, {remedy}.")
    return lines


def _only_exact(calibrated: Calibrated) -> Iterator[str]:
    """The statements that only the exact fit uses."""
    exact = calibrated.exact
    if exact.problem.correlated:
        source = (
            "noise model of the recording" if exact.problem.noise_of_recording else "slow noise that the rig states"
        )
        yield (
            f"noise: the exact fit uses the {source}, with the correlation between neighbouring positions; "
            "the other methods assume independent positions with the sd columns"
        )
    if exact.problem.with_prior and len(calibrated.fits) > 1:
        yield "Only the exact fit uses the stated priors."
