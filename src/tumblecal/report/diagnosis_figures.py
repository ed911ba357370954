"""Figures of a diagnosis: residuals against everything recorded, their harmonics, the explanations."""

from pathlib import Path

import numpy as np

from tumblecal.diagnosis.diagnose import Diagnosis
from tumblecal.diagnosis.verdict import label_words
from tumblecal.report.drawing import AXIS_COLOUR, INK, MUTED, new_figure, save


AXES = ("x", "y", "z")
_MOST_EXPLANATIONS = 8


def draw_all(found: Diagnosis, folder: Path) -> list[str]:
    """Draw all figures of a diagnosis into `folder` (SVG); returns their names."""
    names = ["residuals_by_angle.svg", "residuals_by_column.svg", "residual_harmonics.svg", "explanations.svg"]
    for name, draw in zip(names, (_by_angle, _by_column, _harmonics, _explanations), strict=True):
        draw(folder / name, found)
    return names


def _limits(found: Diagnosis) -> float:
    """Two sd of the noise that the best explanation leaves, mg."""
    return 2e3 * found.sigma_g


def _by_angle(path: Path, found: Diagnosis) -> None:
    """Residuals against alpha for every axis and pitch setting, before (grey rings) and after."""
    pitch = np.asarray(found.where.index("pitch"))
    settings = np.unique(pitch)[:8]
    figure = new_figure(max(4.5, 2.2 * len(settings) + 1.2), 5.2)
    panels = figure.subplots(3, len(settings), sharex=True, sharey="row", squeeze=False)
    inserted = found.extended is not found.nominal
    for column, setting in enumerate(settings):
        here = np.flatnonzero(pitch == setting)
        here = here[np.argsort(found.data.alpha_deg[here], kind="stable")]
        alpha = found.data.alpha_deg[here]
        for row, axis in enumerate(AXES):
            panel = panels[row, column]
            panel.axhspan(-_limits(found), _limits(found), color="#efefef", zorder=0)
            panel.axhline(0, color=INK, lw=0.7)
            before, after = found.nominal.residuals[here, row] * 1e3, found.extended.residuals[here, row] * 1e3
            if inserted:
                panel.plot(alpha, before, "o", ms=4, mfc="none", color=MUTED, label="nominal model")
            kept = found.extended.keep[here]
            panel.plot(
                alpha[kept],
                after[kept],
                "o",
                ms=3.5,
                color=AXIS_COLOUR[axis],
                label="extended" if inserted else "model",
            )
            if row == 0:
                panel.set_title(f"beta {found.data.beta_deg[here[0]]:g} deg")
            if column == 0:
                panel.set_ylabel(f"{axis}: measured -\npredicted / mg")
            if row == 2:
                panel.set_xlabel("alpha / deg")
    handles, words = panels[0, -1].get_legend_handles_labels()
    figure.legend(handles, words, loc="outside upper right", ncols=2, fontsize=7)
    save(figure, path)


def _by_column(path: Path, found: Diagnosis) -> None:
    """Residuals of the nominal model against the axis's own input, beta, time and temperature."""
    columns: dict[str, np.ndarray] = {
        "own input / g": found.screened.linear.evaluation.inputs,
        "beta / deg": found.data.beta_deg,
    }
    if found.data.time_s is not None:
        columns["time / min"] = (found.data.time_s - found.data.time_s.min()) / 60
    else:
        columns["measuring order"] = np.arange(len(found.data)) + 1.0
    if found.data.temperature_degc is not None:
        columns["temperature / degC"] = found.data.temperature_degc
    figure = new_figure(2.3 * len(columns) + 1, 5.2)
    panels = figure.subplots(3, len(columns), sharey="row", squeeze=False)
    for row, axis in enumerate(AXES):
        for place, (words, values) in enumerate(columns.items()):
            panel = panels[row, place]
            across = values[:, row] if values.ndim == 2 else values
            panel.axhspan(-_limits(found), _limits(found), color="#efefef", zorder=0)
            panel.axhline(0, color=INK, lw=0.7)
            panel.plot(across, found.nominal.residuals[:, row] * 1e3, "o", ms=3.5, color=AXIS_COLOUR[axis])
            if row == 2:
                panel.set_xlabel(words)
        panels[row, 0].set_ylabel(f"{axis}: nominal\nresidual / mg")
    save(figure, path)


def _harmonics(path: Path, found: Diagnosis) -> None:
    """Amplitude of the residual's harmonics in units of their sd, a bar for every pitch setting."""
    figure = new_figure(7.5, 2.8)
    panels = figure.subplots(1, 3, sharey=True)
    settings = sorted({one.pitch for one in found.harmonics})
    width = 0.8 / len(settings)
    betas = {setting: found.data.beta_deg[np.asarray(found.where.index("pitch")) == setting][0] for setting in settings}
    for panel, axis in zip(panels, AXES, strict=True):
        for place, setting in enumerate(settings):
            own = [one for one in found.harmonics if one.axis == axis and one.pitch == setting]
            sizes = [np.hypot(one.cosine, one.sine) / one.sd for one in own]
            shade = 0.35 + 0.65 * (place + 1) / len(settings)
            centres = np.array([one.order for one in own]) + (place - (len(settings) - 1) / 2) * width
            panel.bar(centres, sizes, width, color=AXIS_COLOUR[axis], alpha=shade, label=f"beta {betas[setting]:g}")
        panel.axhline(3, color=INK, lw=0.8, ls="--")
        panel.set_axisbelow(True)
        panel.set_title(f"axis {axis}")
        panel.set_xlabel("harmonic of alpha")
        panel.set_xticks(range(5))
    panels[0].set_ylabel("residual amplitude / sd")
    panels[-1].legend(fontsize=7)
    save(figure, path)


def _explanations(path: Path, found: Diagnosis) -> None:
    """Probability of the leading explanations; light: of the sets that the data cannot tell from it."""
    listed = found.screened.explanations[:_MOST_EXPLANATIONS][::-1]
    figure = new_figure(7.5, 0.35 * len(listed) + 1.1)
    panel = figure.subplots()
    rows = range(len(listed))
    panel.barh(rows, [one.probability for one in listed], color="#cfdcea", label="with those not to be told apart")
    panel.barh(rows, [one.own_probability for one in listed], color=AXIS_COLOUR["x"], label="this one alone")
    words = [label_words(one.labels) or "adequate" for one in listed]
    words = [
        text + (f"  (or {len(one.equivalents)} more)" if one.equivalents else "")
        for text, one in zip(words, listed, strict=True)
    ]
    panel.set_yticks(list(rows), words)
    panel.set_xlim(0, 1)
    panel.set_xlabel("posterior probability (linear screen)")
    if any(one.equivalents for one in listed):
        panel.legend(loc="lower right", fontsize=7)
    panel.grid(axis="y", visible=False)
    save(figure, path)
