"""Each finding's signal in the readings against the variable that drives it, and its figures: without and with the cause."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause, id_of
from tumblecal.diagnosis.coefficients import findings_of_causes, first_unnamed
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.estimation.fit import Fit
from tumblecal.ground.axes import AXES
from tumblecal.ground.supplement import supplement
from tumblecal.report.drawing import AXIS_COLOUR, BAND, INK, MUTED, OUTSIDE, new_figure
from tumblecal.report.unnamed_figure import small_unnamed_figure


# A variable drives a signal if a smooth function of it makes this share of its variance (corrected for the number of
# coefficients); variables that are worse than the best by less than the second number are equals.
_DRIVES, _EQUAL = 0.8, 0.02
_DEGREE, _HARMONICS, _POINTS = 4, 3, 60

Values = Float[np.ndarray, " positions"]


class FindingSignal(NamedTuple):
    """One finding in the readings of the axis where it is largest.

    - `label`: of its first cause; `axis`: number of the axis.
    - `variable`: what it is drawn against, with its unit; `across`: its values.
    - `before`: measured minus predicted by the extended model without this cause, g; `after`: with it.
    - `curve`: points (`across`, g) of its fitted signal; empty for positions that the fit leaves out, marked by `marked`.
    - `size`: standard deviation of its signal in all readings over the noise.
    """

    label: str
    axis: int
    variable: str
    across: Values
    before: Values
    after: Values
    curve: tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]
    marked: Bool[np.ndarray, " positions"]
    size: float


def finding_signals(diagnosis: Diagnosis) -> dict[int, FindingSignal]:
    """The signal of each finding of the best explanation by its number, the largest first, without those that fail."""
    signals = dict[int, FindingSignal]()
    for number, causes in findings_of_causes(diagnosis).items():
        with supplement(f"{diagnosis.data.source}: figure of finding {number}"):
            signals[number] = _signal(diagnosis, causes)
    return dict(sorted(signals.items(), key=lambda item: -item[1].size))


def _signal(diagnosis: Diagnosis, causes: Sequence[Cause]) -> FindingSignal:
    fit, sd = diagnosis.extended, diagnosis.level * diagnosis.problem.sd
    order = np.arange(len(diagnosis.data)) + 1.0
    cause = causes[0]
    marked = np.isin(np.arange(len(diagnosis.data)), [position for cause in causes for position in cause.left_out])
    if np.any(marked):
        before = fit.residuals
        size = np.where(marked[:, None], before / sd, 0.0)
        axis = int(np.argmax(np.sum(size**2, axis=0)))
        nothing, rms = np.zeros(0), float(np.sqrt(np.mean(size**2)))
        values = before[:, axis], before[:, axis], (nothing, nothing)
        return FindingSignal(cause.label, axis, "position number", order, *values, marked, rms)
    signal = _component(diagnosis, causes)
    axis = int(np.argmax(np.nanmean((signal / sd) ** 2, axis=0)))
    variable, across, curve = _driven(diagnosis, cause, signal[:, axis], axis)
    size = float(np.sqrt(np.nanmean(np.nanvar(signal / sd, axis=0))))
    after = np.where(fit.retained, fit.residuals[:, axis], np.nan)
    return FindingSignal(cause.label, axis, variable, across, after + signal[:, axis], after, curve, marked, size)


def _component(diagnosis: Diagnosis, causes: Sequence[Cause]) -> Float[np.ndarray, "positions 3"]:
    """Contribution of causes to the readings, g: prediction of the extended model less that without their coefficients. For
    causes without coefficients: residuals of the fit with all others less those of the extended model. NaN for excluded
    positions."""
    fit, model, where = diagnosis.extended, diagnosis.model, diagnosis.problem.where
    columns = [column for cause in causes for column in cause.slot.columns]
    if columns:
        without = fit.vector.copy()
        without[columns] = model.start[columns]
        signal = model.predict(where, fit.vector) - model.predict(where, without)
    else:
        others = [member for member in diagnosis.members if all(member is not cause for cause in causes)]
        signal = (fit_with(diagnosis.screened.at, others) if others else diagnosis.nominal).residuals - fit.residuals
    return np.where(fit.retained[:, None], signal, np.nan)


def _driven(diagnosis: Diagnosis, cause: Cause, signal: Values, axis: int) -> tuple:
    """The variable of which the signal is a function, its values, and the curve; if there is none, the signal itself."""
    tried = []
    for words, across in _variables(diagnosis, cause, signal, axis):
        valid = np.isfinite(signal) & np.isfinite(across)
        if np.any(valid) and np.ptp(across[valid]) > 0:
            share, curve = _smooth(across[valid], signal[valid], circular=words.startswith("alpha"))
            tried.append((share, words, across, curve))
    best = max((share for share, *_ in tried), default=0.0)
    if best < _DRIVES:
        ends = np.array([np.nanmin(signal), np.nanmax(signal)])
        return "fitted signal / mg", 1e3 * signal, (1e3 * ends, ends)
    return next((words, across, curve) for share, words, across, curve in tried if share > best - _EQUAL)


def _variables(diagnosis: Diagnosis, cause: Cause, signal: Values, axis: int) -> Iterator[tuple[str, Values]]:
    """Variables that may drive a signal, the most likely first: columns of the cause, inputs, their products, angles, order."""
    data, inputs = diagnosis.data, diagnosis.screened.at.evaluation.inputs
    entry = diagnosis.entries.get(id_of(cause.label))
    needs = ("time_s", "temperature_degc") if entry is None else entry.needs
    named = [(f"u_{AXES[k]}", inputs[:, k]) for k in (axis, *(k for k in range(3) if k != axis))]
    slow = []
    if data.time_s is not None and "time_s" in needs:
        slow.append(("time", "min", (data.time_s - data.time_s.min()) / 60))
    if data.temperature_degc is not None and "temperature_degc" in needs:
        slow.append(("temperature", "°C", data.temperature_degc))
    yield from ((f"{name} / {unit}", values) for name, unit, values in slow)
    yield from ((f"{name} / g", values) for name, values in named)
    for name, unit, values in slow:
        centred = values - values.mean()
        yield from ((f"({name} - mean) {driver} / {unit} g", centred * across) for driver, across in named)
    pairs = ((named[i], named[j]) for i, j in ((0, 1), (0, 2), (1, 2)))
    yield from ((f"{first} {second} / g²", one * other) for (first, one), (second, other) in pairs)
    yield "beta / °", data.beta_deg
    yield "alpha / °", data.alpha_deg
    yield from _at_one_setting(data.alpha_deg, data.pitch_setting_deg, signal)
    yield "position number", np.arange(len(data)) + 1.0


def _at_one_setting(alpha: Values, pitch: Values, signal: Values) -> Iterator[tuple[str, Values]]:
    """The spindle angle at the pitch setting at which a signal is largest, NaN at the others."""
    squares = {setting: np.nanmean(signal[pitch == setting] ** 2) for setting in np.unique(pitch[np.isfinite(signal)])}
    largest = max(squares, key=lambda setting: squares[setting])
    yield f"alpha / ° at beta {largest:g}°", np.where(pitch == largest, alpha, np.nan)


def _smooth(across: Values, signal: Values, *, circular: bool) -> tuple[float, tuple]:
    """Share of a signal's variance that a smooth function of a variable makes, and points of that function."""
    centre, half = 0.5 * (across.max() + across.min()), 0.5 * np.ptp(across)
    # At most half as many coefficients as values: with as many, any signal would be a function of the variable.
    most = len(across) // 2 - 1
    degree, harmonics = min(_DEGREE, most, len(np.unique(np.round(across, 6))) - 1), min(_HARMONICS, most // 2)

    def columns(values: Values) -> Float[np.ndarray, "points columns"]:
        if circular:
            turns = np.outer(np.radians(values), np.arange(1, harmonics + 1))
            return np.column_stack([np.ones(len(values)), np.cos(turns), np.sin(turns)])
        return np.polynomial.legendre.legvander((values - centre) / half, degree)

    known = columns(across)
    coefficients, *_ = np.linalg.lstsq(known, signal, rcond=None)
    freedom, lost = len(signal) - known.shape[1], np.sum((signal - known @ coefficients) ** 2)
    if freedom < 1 or most < 1:
        return 0.0, ()
    whole = np.sum((signal - signal.mean()) ** 2) / (len(signal) - 1)
    fine = np.linspace(across.min(), across.max(), _POINTS)
    share = 1.0 - float(lost / freedom / whole) if whole > 0 else 0.0
    return share, (fine, columns(fine) @ coefficients)


_BEFORE, _AFTER, _CURVE, _LEFT_OUT = "without this effect", "with it", "fitted effect", "excluded from the fit"


def card_figures(diagnosis: Diagnosis, signals: Mapping[int, FindingSignal]) -> dict[int, Callable[[], Figure]]:
    """Functions that draw the cards, by number of the finding; 0: the card of a verdict without a finding."""
    figures: dict[int, Callable[[], Figure]] = {number: partial(small_figure, signals[number]) for number in signals}
    if diagnosis.unnamed is not None:
        figures[first_unnamed(diagnosis)] = partial(small_unnamed_figure, diagnosis, diagnosis.unnamed)
    return figures or {0: partial(overview_figure, diagnosis.nominal)}


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
