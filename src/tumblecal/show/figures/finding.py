"""Each finding's signal in the readings against the variable that drives it, and its figures: without and with the cause."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause, id_of
from tumblecal.diagnosis.coefficients import findings_of_causes, first_unnamed
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.ground.axes import AXES
from tumblecal.ground.result_set import supplement
from tumblecal.show.figures.calibration import overview_figure
from tumblecal.show.figures.drawing import (
    AXIS_COLOUR,
    CARD,
    INK,
    MUTED,
    OUTSIDE,
    OfAxes,
    Shown,
    Values,
    marks,
    new_panel,
    noise_band,
    with_legend,
)
from tumblecal.show.figures.evidence import noise_of
from tumblecal.show.figures.unnamed import small_unnamed_figure
from tumblecal.show.figures.variables import conditions


# A variable drives a signal if a smooth function of it makes this share of its variance (corrected for the number of
# coefficients); variables that are worse than the best by less than the second number are equals.
_DRIVES, _EQUAL = 0.8, 0.02
_DEGREE, _HARMONICS, _POINTS = 4, 3, 60
_Curve = tuple[np.ndarray, np.ndarray]


class FindingSignal(NamedTuple):
    """One finding in the readings of the axis where it is largest.

    - `label`: of its first cause; `axis`: number of the axis.
    - `variable`: what it is drawn against, with its unit; `across`: its values.
    - `curve`: points (`across`, g) of its fitted signal; empty for positions that the fit leaves out, marked by `marked`.
    - `before`: measured minus predicted by the extended model without this cause, g; `after`: with it.
    - `size`: standard deviation of its signal in all readings over the noise.
    """

    label: str
    axis: int
    variable: str
    across: Values
    curve: _Curve
    before: Values
    after: Values
    marked: Shown
    size: float


def finding_signals(diagnosis: Diagnosis) -> dict[int, FindingSignal]:
    """The signal of each finding of the best explanation by its number, the largest first, without those that fail."""
    signals = dict[int, FindingSignal]()
    for number, causes in findings_of_causes(diagnosis).items():
        with supplement(f"{diagnosis.data.source}: figure of finding {number}"):
            signals[number] = _signal(diagnosis, causes)
    return dict(sorted(signals.items(), key=lambda item: -item[1].size))


def _signal(diagnosis: Diagnosis, causes: Sequence[Cause]) -> FindingSignal:
    fit, order, nothing = diagnosis.extended, np.arange(len(diagnosis.data)), np.zeros(0)
    marked = np.isin(order, [position for cause in causes for position in cause.left_out])
    excluded = bool(np.any(marked))
    signal = np.where(marked[:, None], fit.residuals, 0.0) if excluded else _component(diagnosis, causes)
    relative = signal / (diagnosis.level * diagnosis.problem.sd)
    axis = int(np.argmax(np.nanmean(relative**2, axis=0)))
    driven = ("position number", order + 1.0, (nothing, nothing))
    if not excluded:
        driven = _driven(diagnosis, causes[0], signal[:, axis], axis)
    after = np.where((fit.retained | marked)[:, None], fit.residuals, np.nan)[:, axis]
    before = after if excluded else after + signal[:, axis]
    size = float(np.sqrt(np.nanmean(np.nanvar(relative, axis=0))))
    return FindingSignal(causes[0].label, axis, *driven, before, after, marked, size)


def _component(diagnosis: Diagnosis, causes: Sequence[Cause]) -> OfAxes:
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


def _driven(diagnosis: Diagnosis, cause: Cause, signal: Values, axis: int) -> tuple[str, Values, _Curve]:
    """The variable of which the signal is a function, its values, and the curve; if there is none, the signal itself."""
    tried = []
    for words, across in _variables(diagnosis, cause, axis, signal):
        valid = np.isfinite(signal + across)
        if np.ptp(across[valid]) > 0:
            share, curve = _smooth(across[valid], signal[valid], circular=words.startswith("alpha"))
            tried.append((share, (words, across, curve)))
    best = max(share for share, _ in tried)
    if best < _DRIVES:
        ends = np.array([np.nanmin(signal), np.nanmax(signal)])
        return "fitted signal / mg", 1e3 * signal, (1e3 * ends, ends)
    return next(driven for share, driven in tried if share > best - _EQUAL)


def _variables(diagnosis: Diagnosis, cause: Cause, axis: int, signal: Values) -> Iterator[tuple[str, Values]]:
    """Variables that may drive a signal, the most likely first: conditions, inputs, their products, and the spindle angle,
    also at the pitch setting with the largest signal alone, NaN at the others."""
    data, inputs = diagnosis.data, diagnosis.screened.at.evaluation.inputs
    entry = diagnosis.entries.get(id_of(cause.label))
    slow = [
        (name, unit, values)
        for name, (unit, values) in conditions(data).items()
        if entry is None or any(need.startswith(name) for need in entry.needs)
    ]
    driving = [(f"u_{AXES[k]}", "g", inputs[:, k]) for k in (axis, axis - 1, axis - 2)]
    yield from ((f"{name} / {unit}", values) for name, unit, values in slow + driving)
    centred = [(f"({name} - mean)", unit, values - values.mean()) for name, unit, values in slow]
    for (name, unit, values), (driver, last, across) in combinations(centred + driving, 2):
        if last == "g":
            yield f"{name} {driver} / {unit} g".replace("g g", "g²"), values * across
    yield "alpha / °", data.alpha_deg
    pitch = data.pitch_setting_deg
    largest = max(np.unique(pitch).tolist(), key=lambda setting: np.nansum(signal[pitch == setting] ** 2))
    yield f"alpha / ° at beta {largest:g}°", np.where(pitch == largest, data.alpha_deg, np.nan)


def _smooth(across: Values, signal: Values, *, circular: bool) -> tuple[float, _Curve]:
    """Share of a signal's variance that a smooth function of a variable makes, and points of that function."""
    # At most half as many coefficients as values: with as many, any signal would be a function of the variable.
    count, most = len(across), len(across) // 2 - 1
    if most < 1 or np.ptp(signal) == 0:
        return 0.0, (across, signal)
    places = np.concatenate([across, np.linspace(across.min(), across.max(), _POINTS)])
    if circular:
        turns = np.outer(np.radians(places), np.arange(min(_HARMONICS, most // 2) + 1))
        columns = np.hstack([np.cos(turns), np.sin(turns[:, 1:])])
    else:
        degree = min(_DEGREE, most, len(np.unique(np.round(across, 6))) - 1)
        columns = np.vander((places - across.mean()) / np.ptp(across), degree + 1)
    coefficients, *_ = np.linalg.lstsq(columns[:count], signal)
    smooth = columns @ coefficients
    remaining = np.sum((signal - smooth[:count]) ** 2) / (count - len(coefficients))
    return 1.0 - float(remaining / np.var(signal, ddof=1)), (places[count:], smooth[count:])


def card_figures(diagnosis: Diagnosis, signals: Mapping[int, FindingSignal]) -> dict[int, Callable[[], Figure]]:
    """Functions that draw the cards, by number of the finding; 0: the card of a verdict without a finding."""
    figures = {number: partial(small_figure, signal) for number, signal in signals.items()}
    if diagnosis.unnamed is not None:
        figures[first_unnamed(diagnosis)] = partial(small_unnamed_figure, diagnosis, diagnosis.unnamed)
    return figures or {0: partial(overview_figure, diagnosis.nominal)}


def small_figure(signal: FindingSignal) -> Figure:
    """For a card: residuals without the cause, and its curve."""
    figure, panel = new_panel(1.55, CARD, xlabel=signal.variable, ylabel=f"{AXES[signal.axis]} residual / mg")
    panel.locator_params(axis="x", nbins=6)
    panel.axhline(0, color=INK, lw=0.6)
    _residuals(panel, signal)
    return figure


def finding_figure(signal: FindingSignal, diagnosis: Diagnosis) -> Figure:
    """For the part of residuals: residuals without and with the cause over the noise band, and its curve."""
    axis = signal.axis
    figure, panel = new_panel(3.0, xlabel=signal.variable, ylabel=f"{AXES[axis]}: measured -\npredicted / mg")
    noise_band(panel, 2e3 * noise_of(diagnosis)[axis], "± 2 noise sd")
    if len(signal.curve[0]):
        marks(panel, signal.across, 1e3 * signal.after, AXIS_COLOUR[AXES[axis]], "with it", ring=True)
    _residuals(panel, signal)
    return with_legend(figure, 5)


def _residuals(panel: Axes, signal: FindingSignal) -> None:
    """Residuals without the effect, and its curve; positions that the fit leaves out are crosses."""
    across, before = signal.across, 1e3 * signal.before
    marks(panel, across[~signal.marked], before[~signal.marked], MUTED, "without this effect")
    if len(signal.curve[0]):
        along, curve = signal.curve
        panel.plot(along, 1e3 * curve, lw=1.8, color=AXIS_COLOUR[AXES[signal.axis]], label="fitted effect")
    else:
        panel.plot(
            across[signal.marked], before[signal.marked], "X", ms=7, color=OUTSIDE, label="excluded from the fit"
        )
