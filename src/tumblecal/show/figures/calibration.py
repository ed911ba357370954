"""Figures of a calibration: residuals by position, and the methods compared."""

import numpy as np
from matplotlib.figure import Figure

from tumblecal.estimation.fit import Fit
from tumblecal.estimation.methods import Calibrated
from tumblecal.ground.axes import AXES
from tumblecal.show.figures.drawing import (
    AXIS_COLOUR,
    CARD,
    MUTED,
    OUTSIDE,
    Figures,
    marks,
    new_panel,
    new_rows,
    noise_band,
    with_legend,
)
from tumblecal.show.figures.residuals import Group, angle_columns, residual_figure
from tumblecal.show.fit import TITLES


# Differences up to this many standard uncertainties have a linear scale.
_LINEAR = 10.0
_LOOKS = {"harmonic": ("s", "#E69F00"), "kalman": ("o", "#0072B2")}


def residuals_figure(exact: Fit) -> Figure:
    """Residuals against the spindle angle: a row for each axis, a column for each pitch setting."""
    data, residuals = exact.data, 1e3 * exact.residuals
    noise, sd = _noise(exact)
    band, bars, name, largest = 2e3 * sd, None, "measured - predicted", np.abs(residuals)
    words = f"2 standard deviations of the {noise}, {band:.2g} mg"
    if data.sd is not None:
        # They may differ from one position to the next.
        band, bars, name, words = 0.0, 2e3 * data.sd, "bars: 2 standard deviations, stated", ""
        largest = largest + bars
    columns = angle_columns(data, [Group(name, residuals, np.ones(len(data), bool), bars=bars)])
    reach = np.full((3, 1), 1.1 * np.max(largest, initial=band))
    return residual_figure(columns, np.full(3, band), reach, words)


def _noise(fit: Fit) -> tuple[str, float]:
    """Source and standard deviation of the noise, g."""
    stated = fit.noise == "stated"
    return ("stated noise", float(np.median(fit.problem.sd))) if stated else ("residuals", fit.sigma)


def methods_figure(calibrated: Calibrated) -> Figure:
    """Difference of every method from the exact fit for every parameter, in standard uncertainties."""
    exact, others = calibrated.exact, {name: fit for name, fit in calibrated.fits.items() if name != "exact"}
    figure, panel = new_rows(exact.names, 0.24, "difference from the exact fit / u")
    for place, colour, words in ((0, OUTSIDE, "exact"), (-1, MUTED, "1 u"), (1, MUTED, "1 u")):
        panel.axvline(place, color=colour, label=words)
    farthest = 1e-6 if others else 1.0
    for name, fit in others.items():
        values = [fit.value(parameter) if parameter in fit.names else np.nan for parameter in exact.names]
        shift = (values - exact.values) / exact.sd
        farthest = max(farthest, np.nanmax(np.abs(shift)))
        marker, colour = _LOOKS[name]
        panel.plot(shift, range(len(shift)), marker, ms=5, mfc="none", color=colour, label=TITLES[name])
    if farthest > _LINEAR:
        panel.set_xscale("symlog", linthresh=1.0)
    panel.set_xlim(-1.15 * farthest, 1.15 * farthest)
    return with_legend(figure)


def overview_figure(fit: Fit) -> Figure:
    """For the card of a verdict without a finding: all residuals in the order of the positions, over the noise band."""
    figure, panel = new_panel(1.75, CARD, xlabel="position number", ylabel="residual / mg")
    noise_band(panel, 2e3 * _noise(fit)[1], "± 2 noise sd")
    for axis, values in zip(AXES, 1e3 * fit.residuals.T, strict=True):
        marks(panel, np.arange(len(values)) + 1, values, AXIS_COLOUR[axis], axis)
    return with_legend(figure)


FIGURES: Figures = {
    "residuals.svg": lambda calibrated: residuals_figure(calibrated.exact),
    "methods.svg": lambda calibrated: methods_figure(calibrated) if len(calibrated.fits) > 1 else None,
}
