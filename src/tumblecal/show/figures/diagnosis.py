"""Figures of a diagnosis: residuals against all recorded variables, their harmonics, probabilities, and the list of all."""

import textwrap
from collections.abc import Sequence
from functools import partial
from itertools import cycle, product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import label_words
from tumblecal.diagnosis.findings.residuals import discrepancies
from tumblecal.ground.axes import AXES
from tumblecal.show.figures.drawing import BLUE, INK, MUTED, OUTSIDE, Figures, new_panels, new_rows, with_legend
from tumblecal.show.figures.evidence import limits_figure, models_of, noise_of, predictive_figure
from tumblecal.show.figures.finding import finding_figure, finding_signals
from tumblecal.show.figures.residuals import Column, Group, angle_columns, residual_figure
from tumblecal.show.figures.unnamed import unnamed_figure
from tumblecal.show.figures.variables import conditions


_MOST_EXPLANATIONS, _LEAST_SHOWN, _LABEL_WIDTH = 8, 2e-3, 46
# If the largest residual exceeds so many times the usual size, the scale ends at a smaller multiple.
_BEYOND, _CUT = 5.0, 2.0
_RUN_MARKERS = "os^Dv"


def figures_of(diagnosis: Diagnosis) -> Figures:
    """The functions that draw the files of a diagnosis, by name."""
    signals = finding_signals(diagnosis)
    return {f"finding_{number}.svg": partial(finding_figure, signal) for number, signal in signals.items()} | {
        "unexplained.svg": unnamed_figure,
        "residuals_by_angle.svg": angle_figure,
        "residuals_by_column.svg": column_figure,
        "residual_harmonics.svg": harmonics_figure,
        "predictive.svg": predictive_figure,
        "limits.svg": limits_figure,
    }


def angle_figure(diagnosis: Diagnosis) -> Figure:
    """Residuals against alpha for every axis and pitch setting, before (grey rings) and after."""
    return _residuals(diagnosis, angle_columns(diagnosis.data, _groups(diagnosis)))


def column_figure(diagnosis: Diagnosis) -> Figure:
    """Residuals against the input of the axis, beta, time and temperature, before and after."""
    data, groups = diagnosis.data, _groups(diagnosis)
    variables = {"input of the axis / g": diagnosis.screened.at.evaluation.inputs, "beta / °": data.beta_deg}
    if data.time_s is None:
        variables["measuring order"] = np.arange(len(data)) + 1.0
    variables |= {f"{name} / {unit}": values for name, (unit, values) in conditions(data).items()}
    return _residuals(diagnosis, [Column(variable, values, groups) for variable, values in variables.items()])


def _groups(diagnosis: Diagnosis) -> list[Group]:
    """Residuals of the nominal model, of the extended model by run, and of excluded positions."""
    data, retained = diagnosis.data, diagnosis.extended.retained
    (name, fit), *nominal = reversed(models_of(diagnosis).items())
    after, run = 1e3 * fit.residuals, np.array(data.run or data.runs * len(data))
    groups = [Group(words, 1e3 * one.residuals, np.ones(len(data), bool), "o", MUTED, True) for words, one in nominal]
    for label, marker in zip(data.runs, cycle(_RUN_MARKERS), strict=False):
        words = f"{name}, run {label}" if data.run else name
        groups.append(Group(words, after, retained & (run == label), marker))
    return groups if np.all(retained) else [*groups, Group("excluded", after, ~retained, "x", OUTSIDE)]


def _residuals(diagnosis: Diagnosis, columns: list[Column]) -> Figure:
    """Panels with a scale for all residuals, unless a few would compress it for the others."""
    noise, fit = 2e3 * noise_of(diagnosis), diagnosis.extended
    usual = np.maximum(1e3 * np.quantile(np.abs(fit.residuals[fit.retained]), 0.95, axis=0), noise)
    largest = 1e3 * np.max(np.abs([diagnosis.nominal.residuals, fit.residuals]), axis=(0, 1))
    reach = 1.15 * np.where(largest > _BEYOND * usual, _CUT * usual, np.maximum(largest, noise))
    return residual_figure(columns, noise, reach[:, None])


def explanations_figure(diagnosis: Diagnosis) -> Figure:
    """Probability of the leading explanations; light: of the class of indistinguishable sets."""
    listed = diagnosis.leading(_LEAST_SHOWN, _MOST_EXPLANATIONS)
    names = []
    for explanation in listed:
        more = f" (or\u00a0{len(explanation.equivalents)}\u00a0more)" if explanation.equivalents else ""
        names.append(textwrap.fill((label_words(explanation.labels) or "adequate") + more, _LABEL_WIDTH))
    height = 0.3 + 0.1 * "".join(names).count("\n") / len(names)
    figure, panel = new_rows(names, height, "posterior probability (linear screen)")
    rows = range(len(listed))
    of_class, alone = ([e.class_probability for e in listed], [e.own_probability for e in listed])
    panel.barh(rows, of_class, color="#cfdcea", label="class of indistinguishable explanations")
    panel.barh(rows, alone, color=BLUE, label="this one alone")
    panel.set_xlim(0, 1)
    return with_legend(figure)


# Sizes of the harmonics: colours end at the first, words are bold beyond the second; more settings have no words.
_RANGE, _STRONG, _MOST_WORDED = 6.0, 3.0, 12


def harmonics_figure(diagnosis: Diagnosis) -> Figure | None:
    """A cell for every axis, pitch setting and harmonic, before and after; None if no setting has enough angles."""
    found = {name: discrepancies(fit, diagnosis.level) for name, fit in models_of(diagnosis).items()}
    sizes = {(name, h.axis, h.pitch, (h.order, h.wave)): h.in_sd for name, listed in found.items() for h in listed}
    if not sizes:
        return None
    _, _, settings, waves = (sorted(set(part)) for part in zip(*sizes, strict=True))
    pitch = np.asarray(diagnosis.problem.where.index("pitch"))
    betas = [f"{diagnosis.data.pitch_setting_deg[pitch == setting][0]:g}" for setting in settings]
    height = len(found) * (0.2 * len(settings) + 0.55) + 0.75
    figure, panels = new_panels(height, len(found), 3, sharex=True, sharey=True)
    for (name, axis), panel in zip(product(found, AXES), panels.ravel(), strict=True):
        _table(panel, [[sizes.get((name, axis, setting, wave), np.inf) for wave in waves] for setting in settings])
        panel.set(title=f"axis {axis}, {name}", xlabel="harmonic of alpha", ylabel="beta / °")
        panel.label_outer()
    panels[0, 0].set_xticks(range(len(waves)), [f"{wave[0]}{order}" if order else "mean" for order, wave in waves])
    panels[0, 0].set_yticks(range(len(settings)), betas)
    look = {"shrink": 0.9, "aspect": 12 * len(found), "extend": "both", "label": "harmonic / standard deviation"}
    figure.colorbar(panels[0, 0].images[0], ax=panels, **look)
    return figure


def _table(panel: Axes, cells: Sequence[Sequence[float | None]]) -> None:
    """Cells coloured by size; crossed if fitted parameters absorb the harmonic completely (None)."""
    values = np.ma.masked_invalid(np.array(cells, float))
    for (row, column), size in np.ndenumerate(np.array(cells, object)):
        if size is None:
            panel.plot(column, row, "x", mew=0.7, color="#b0b0b0")
        elif np.isfinite(size) and len(cells) <= _MOST_WORDED:
            strong = abs(size) > _STRONG
            ink, weight = ("white" if abs(size) > 0.62 * _RANGE else INK), "bold" if strong else "normal"
            words = f"{size:.{0 if strong else 1}f}"
            panel.text(column, row, words, ha="center", va="center", fontsize=5.5, color=ink, fontweight=weight)
    panel.spines[:].set_visible(False)
    panel.grid(visible=False)
    panel.tick_params(length=0, labelsize=7)
    panel.imshow(values, aspect="auto", cmap="RdBu_r", vmin=-_RANGE, vmax=_RANGE)
