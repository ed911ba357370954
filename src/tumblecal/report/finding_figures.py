"""Figures of findings: residuals without and with a cause, and its fitted curve, against the variable that drives it."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.diagnosis import Diagnosis
from tumblecal.estimation.fit import Fit
from tumblecal.ground.axes import AXES
from tumblecal.report.diagnosis_verdict import first_unnamed
from tumblecal.report.drawing import AXIS_COLOUR, BAND, INK, MUTED, OUTSIDE, new_figure
from tumblecal.report.finding_signals import FindingSignal, finding_signals
from tumblecal.report.unnamed_figure import small_unnamed_figure


_BEFORE, _AFTER, _CURVE, _LEFT_OUT = "without this effect", "with it", "fitted effect", "excluded from the fit"


def card_figures(diagnosis: Diagnosis) -> dict[int, Figure]:
    """Figures for the cards by number of the finding; 0: for the card of a verdict without a finding."""
    drawn = {number: small_figure(signal) for number, signal in finding_signals(diagnosis).items()}
    if diagnosis.unnamed is not None:
        drawn[first_unnamed(diagnosis)] = small_unnamed_figure(diagnosis, diagnosis.unnamed)
    return drawn or {0: overview_figure(diagnosis.nominal)}


def small_figure(signal: FindingSignal) -> Figure:
    """For a card: residuals without the cause, and its curve."""
    figure = new_figure(3.9, 1.55)
    panel = figure.subplots()
    _residuals(panel, signal, after=False)
    panel.tick_params(labelsize=7.5, length=2)
    panel.set_xlabel(signal.variable, fontsize=8)
    panel.set_ylabel(f"{AXES[signal.axis]} residual / mg", fontsize=8)
    panel.locator_params(axis="y", nbins=4)
    return figure


def large_figure(signal: FindingSignal, noise_g: float) -> Figure:
    """For the part of residuals: residuals without and with the cause over the noise band, and its curve."""
    figure = new_figure(7.5, 3.0)
    panel = figure.subplots()
    panel.axhspan(-2e3 * noise_g, 2e3 * noise_g, color=BAND, zorder=0, label="± 2 noise sd")
    _residuals(panel, signal, after=True)
    panel.set_xlabel(signal.variable)
    panel.set_ylabel(f"{AXES[signal.axis]}: measured -\npredicted / mg")
    figure.legend(loc="outside upper right", ncols=5, fontsize=7)
    return figure


def overview_figure(fit: Fit) -> Figure:
    """For the card of a verdict without a finding: all residuals in the order of the positions, over the noise band."""
    figure = new_figure(3.9, 1.75)
    panel = figure.subplots()
    residuals, order = fit.residuals, np.arange(len(fit.residuals)) + 1
    band = 2e3 * (float(np.median(fit.problem.sd)) if fit.problem.known else fit.sigma)
    panel.axhspan(-band, band, color=BAND, zorder=0, label="± 2 noise sd")
    for k, name in enumerate(AXES):
        panel.plot(order, 1e3 * residuals[:, k], "o", ms=2.5, color=AXIS_COLOUR[name], label=name)
    panel.tick_params(labelsize=7.5, length=2)
    panel.set_xlabel("position number", fontsize=8)
    panel.set_ylabel("residual / mg", fontsize=8)
    figure.legend(loc="outside upper right", ncols=4, fontsize=7)
    return figure


def _residuals(panel: Axes, signal: FindingSignal, *, after: bool) -> None:
    across, colour = signal.across, AXIS_COLOUR[AXES[signal.axis]]
    panel.axhline(0, color=INK, lw=0.6)
    drawn = ~signal.marked
    panel.plot(across[drawn], 1e3 * signal.before[drawn], "o", ms=3.2, color=MUTED, mec="none", label=_BEFORE)
    if after and len(signal.curve[0]):
        panel.plot(
            across[drawn], 1e3 * signal.after[drawn], "o", ms=3.2, color=colour, mfc="none", mew=0.8, label=_AFTER
        )
    if np.any(signal.marked):
        panel.plot(across[signal.marked], 1e3 * signal.before[signal.marked], "X", ms=7, color=OUTSIDE, label=_LEFT_OUT)
    if len(signal.curve[0]):
        panel.plot(signal.curve[0], 1e3 * signal.curve[1], "-", lw=1.8, color=colour, label=_CURVE)
