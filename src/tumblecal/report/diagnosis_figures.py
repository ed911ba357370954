"""Figures of a diagnosis: residuals against all recorded variables, their harmonics, and the list of all figures."""

import textwrap
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import label_words
from tumblecal.diagnosis.findings.residuals import Discrepancy, discrepancies
from tumblecal.estimation.fit import Fit
from tumblecal.ground.axes import AXES
from tumblecal.report.drawing import AXIS_COLOUR, INK, MUTED, OUTSIDE, Margins, draw_each, new_figure, new_panels, save
from tumblecal.report.evidence_figures import limits_figure, predictive_figure
from tumblecal.report.finding_figures import finding_signals, large_figure
from tumblecal.report.unnamed_figure import unnamed_figure


# With more pitch settings than this they share one panel.
_MOST_PANELS = 5
_MOST_EXPLANATIONS, _LEAST_SHOWN, _LABEL_WIDTH = 8, 2e-3, 46
# Residuals of the nominal model beyond this multiple of the scale of the extended model are arrows at the edge.
_BEYOND = 5.0
# Residuals of the extended model beyond this many standard deviations of the noise are arrows as well.
_MOST_NOISE = 12.0
# Panels of residuals: room for two lines and the numbers at the left, the legend above, and titles if there are any.
_MARGINS, _TITLES = Margins(left=0.85, right=0.15, bottom=0.5, top=0.32, across=0.14, down=0.14), 0.2
_RUN_MARKERS = "os^Dv"


def draw_all(diagnosis: Diagnosis, folder: Path) -> list[str]:
    """Draw all figures of a diagnosis into `folder` (SVG); returns the names of those drawn."""
    findings = {
        f"finding_{number}.svg": partial(large_figure, signal, _noise(diagnosis, signal.axis))
        for number, signal in finding_signals(diagnosis).items()
    }
    figures = {
        "unexplained.svg": unnamed_figure,
        "residuals_by_angle.svg": angle_figure,
        "residuals_by_column.svg": column_figure,
        "residual_harmonics.svg": harmonics_figure,
        "predictive.svg": predictive_figure,
        "limits.svg": limits_figure,
    }
    others = {name: partial(figure_of, diagnosis) for name, figure_of in figures.items()}
    return [*draw_each(folder, findings | others, save)]


def angle_figure(diagnosis: Diagnosis) -> Figure:
    """Residuals against alpha for every axis and pitch setting, before (grey rings) and after."""
    pitch = np.asarray(diagnosis.problem.where.index("pitch"))
    settings = list(np.unique(pitch))
    groups = [pitch == setting for setting in settings]
    titles = [f"beta {diagnosis.data.pitch_setting_deg[here][0]:g} deg" for here in groups]
    if len(settings) > _MOST_PANELS:
        groups, titles = [np.ones(len(pitch), bool)], [f"all {len(settings)} pitch settings"]
    width = 7.5 if len(groups) == 1 else max(5.5, 2.0 * len(groups) + 1.2)
    alpha = diagnosis.data.alpha_deg
    columns = [_Column(title, alpha, here) for title, here in zip(titles, groups, strict=True)]
    return _residuals(diagnosis, columns, "alpha / deg", width)


def column_figure(diagnosis: Diagnosis) -> Figure:
    """Residuals against the input of the axis, beta, time and temperature, before and after."""
    data, every = diagnosis.data, np.ones(len(diagnosis.data), bool)
    columns = [
        _Column("input of the axis / g", diagnosis.screened.at.evaluation.inputs, every),
        _Column("beta / deg", data.beta_deg, every),
    ]
    if data.time_s is not None:
        columns.append(_Column("time / min", (data.time_s - data.time_s.min()) / 60, every))
    else:
        columns.append(_Column("measuring order", np.arange(len(data)) + 1.0, every))
    if data.temperature_degc is not None:
        columns.append(_Column("temperature / degC", data.temperature_degc, every))
    return _residuals(diagnosis, columns, "", 2.0 * len(columns) + 1)


class _Column(NamedTuple):
    """Panels against one variable: its words, its values, the positions drawn."""

    title: str
    across: np.ndarray
    here: np.ndarray


def _residuals(diagnosis: Diagnosis, columns: list[_Column], words: str, width: float) -> Figure:
    """Panels of residuals, a row for each axis. `words` is the label below the panels; "": the titles of the columns."""
    margins = _MARGINS._replace(top=_MARGINS.top + (_TITLES if words else 0.0))
    figure, panels = new_panels(width, 5.2, 3, len(columns), margins)
    for row in range(3):
        reach = _reach(diagnosis, row)
        for panel, (title, values, here) in zip(panels[row], columns, strict=True):
            _scatter(panel, diagnosis, values[:, row] if values.ndim == 2 else values, row, here, reach)
            if row == 0 and words:
                panel.set_title(title)
            if row == 2:
                panel.set_xlabel(words or title)
            if words.startswith("alpha") and np.ptp(values) > 200:
                panel.set_xticks([0, 90, 180, 270, 360] if len(columns) < 4 else [0, 180, 360])
        panels[row, 0].set_ylim(-reach, reach)
        panels[row, 0].set_ylabel(f"{AXES[row]}: measured -\npredicted / mg")
    handles = {}
    for panel in panels.ravel():
        of_panel, labels = panel.get_legend_handles_labels()
        handles |= {label: handle for label, handle in zip(labels, of_panel, strict=True) if label not in handles}
    if len(handles) > 1:
        figure.legend(handles.values(), handles.keys(), loc="upper right", ncols=6, fontsize=7)
    return figure


def _noise(diagnosis: Diagnosis, row: int) -> float:
    """Standard deviation of the noise of an axis under the noise model in use, g."""
    sigma = diagnosis.level
    return float(sigma / np.median(1.0 / diagnosis.problem.sd[:, row]))


def _reach(diagnosis: Diagnosis, row: int) -> float:
    """Half the height of the panels of an axis, mg: all residuals, unless a few would compress the scale of the rest."""
    retained, noise = diagnosis.extended.retained, _noise(diagnosis, row)
    after = max(np.max(np.abs(diagnosis.extended.residuals[retained, row]), initial=0.0), 2.2 * noise)
    after = after if after < _MOST_NOISE * noise else 0.5 * _MOST_NOISE * noise
    every = max(np.max(np.abs(fit.residuals[:, row])) for fit in (diagnosis.nominal, diagnosis.extended))
    return 1.15e3 * (every if every < _BEYOND * after else 1.5 * after)


def _scatter(panel: Axes, diagnosis: Diagnosis, across: np.ndarray, row: int, here: np.ndarray, reach: float) -> None:
    """The residuals of one axis over a band of two standard deviations; beyond the scale arrows, excluded positions crosses."""

    def points(values: np.ndarray, shown: np.ndarray, marker: str, colour: str, words: str) -> None:
        """Rings (of the nominal model) or dots; values beyond the scale as arrows at its edge."""
        ring = colour == MUTED
        look = {"ms": 4 if ring else 3.2, "color": colour, "mfc": "none" if ring else colour, "ls": "none"}
        inside = shown & (np.abs(values) <= reach)
        panel.plot(across[inside], values[inside], marker, **look)
        key = {"ms": look["ms"], "color": colour if ring else INK, "mfc": "none" if ring else INK, "ls": "none"}
        panel.plot([], [], marker, label=words, **key)
        for arrow, beyond in (("^", shown & (values > reach)), ("v", shown & (values < -reach))):
            if np.any(beyond):
                panel.plot(across[beyond], np.sign(values[beyond]) * 0.94 * reach, arrow, **look)
                panel.plot([], [], arrow, color=MUTED, mfc="none", ms=4, ls="none", label="beyond the scale")

    inserted, retained = diagnosis.extended is not diagnosis.nominal, diagnosis.extended.retained
    band = 2e3 * _noise(diagnosis, row)
    panel.axhspan(-band, band, color="#efefef", zorder=0, label="2 standard deviations of the noise")
    panel.axhline(0, color=INK, lw=0.7)
    before, after = diagnosis.nominal.residuals[:, row] * 1e3, diagnosis.extended.residuals[:, row] * 1e3
    if inserted:
        points(before, here, "o", MUTED, "nominal model")
    runs, words = diagnosis.data.runs, "extended" if inserted else "model"
    run_of = np.array(diagnosis.data.run or ("1",) * len(diagnosis.data))
    several_runs = 1 < len(runs) <= len(_RUN_MARKERS)
    for number, run in enumerate(runs):
        marker, label = (_RUN_MARKERS[number], f"{words}, run {run}") if several_runs else ("o", words)
        points(after, here & retained & (run_of == run), marker, AXIS_COLOUR[AXES[row]], label)
    excluded = here & ~retained
    if np.any(excluded):
        edge = np.clip(after[excluded], -0.94 * reach, 0.94 * reach)
        panel.plot(across[excluded], edge, "x", ms=5, color=OUTSIDE, ls="none", label="excluded")


def explanations_figure(diagnosis: Diagnosis) -> Figure:
    """Probability of the leading explanations; light: of the class of indistinguishable sets."""
    listed = diagnosis.leading(_LEAST_SHOWN, _MOST_EXPLANATIONS)[::-1]
    words = []
    for explanation in listed:
        more = f" (or\u00a0{len(explanation.equivalents)}\u00a0more)" if explanation.equivalents else ""
        words.append(textwrap.fill((label_words(explanation.labels) or "adequate") + more, _LABEL_WIDTH))
    figure = new_figure(7.5, 0.3 * len(listed) + 0.1 * sum(text.count("\n") for text in words) + 0.95)
    panel = figure.subplots()
    rows = range(len(listed))
    panel.barh(
        rows, [e.class_probability for e in listed], color="#cfdcea", label="class of indistinguishable explanations"
    )
    panel.barh(rows, [e.own_probability for e in listed], color=AXIS_COLOUR["x"], label="this one alone")
    panel.set_yticks(list(rows), words)
    panel.set_xlim(0, 1)
    panel.set_xlabel("posterior probability (linear screen)")
    if any(e.equivalents for e in listed):
        panel.legend(loc="lower right", fontsize=7)
    panel.grid(axis="y", visible=False)
    panel.set_axisbelow(True)
    return figure


_RANGE = 6.0
_MOST_WORDED = 12


def harmonics_figure(diagnosis: Diagnosis) -> Figure | None:
    """A cell for every axis, pitch setting and harmonic, before and after; None if no setting has enough angles."""
    fits: list[tuple[str, Fit]] = [("nominal model", diagnosis.nominal)]
    if diagnosis.extended is not diagnosis.nominal:
        fits.append(("extended model", diagnosis.extended))
    noise = diagnosis.level
    cells = [discrepancies(fit, noise) for _, fit in fits]
    if not cells[0]:
        return None
    settings = sorted({harmonic.pitch for harmonic in cells[0]})
    columns = sorted({(harmonic.order, harmonic.wave) for harmonic in cells[0]})
    names = ["mean" if order == 0 else f"{wave[0]}{order}" for order, wave in columns]
    pitch = np.asarray(diagnosis.problem.where.index("pitch"))
    betas = [f"{diagnosis.data.pitch_setting_deg[pitch == setting][0]:g}" for setting in settings]
    figure = new_figure(7.5, len(fits) * (0.2 * len(settings) + 0.55) + 0.75)
    figure.get_layout_engine().set(hspace=0.12)  # type: ignore[union-attr]
    panels = figure.subplots(len(fits), 3, sharex=True, sharey=True, squeeze=False)
    image = None
    for row, ((name, _), of_fit) in enumerate(zip(fits, cells, strict=True)):
        for panel, axis in zip(panels[row], "xyz", strict=True):
            image = _table(panel, [harmonic for harmonic in of_fit if harmonic.axis == axis], settings, columns)
            panel.set_title(f"axis {axis}, {name}")
            panel.set_xticks(range(len(columns)), names, fontsize=6.5)
            panel.set_yticks(range(len(settings)), betas, fontsize=7)
            panel.tick_params(length=0)
        panels[row, 0].set_ylabel("beta / deg")
    for panel in panels[-1]:
        panel.set_xlabel("harmonic of alpha")
    assert image is not None
    bar = figure.colorbar(image, ax=panels, shrink=0.9, aspect=12 * len(fits), pad=0.015, extend="both")
    bar.set_label("harmonic / standard deviation")
    bar.outline.set_visible(False)  # type: ignore[operator]
    return figure


def _table(panel: Axes, harmonics: list[Discrepancy], settings: list[int], columns: list[tuple[int, str]]) -> AxesImage:
    """Cells coloured by size; crossed if fitted parameters absorb the harmonic completely."""
    values = np.full((len(settings), len(columns)), np.nan)
    panel.set_facecolor("white")
    for harmonic in harmonics:
        cell = settings.index(harmonic.pitch), columns.index((harmonic.order, harmonic.wave))
        if harmonic.in_sd is None:
            panel.plot(cell[1], cell[0], "x", ms=4, mew=0.7, color="#b0b0b0")
            continue
        values[cell] = harmonic.in_sd
        if len(settings) <= _MOST_WORDED:
            strong = abs(harmonic.in_sd) > 3
            words = f"{harmonic.in_sd:.0f}" if strong else f"{round(harmonic.in_sd, 1) + 0.0:.1f}"
            words = words if abs(harmonic.in_sd) < 999 else ">999" if harmonic.in_sd > 0 else "<-999"
            ink, weight = "white" if abs(harmonic.in_sd) > 0.62 * _RANGE else INK, "bold" if strong else "normal"
            panel.text(cell[1], cell[0], words, ha="center", va="center", fontsize=5.5, color=ink, fontweight=weight)
    for side in panel.spines.values():
        side.set_visible(False)
    panel.grid(visible=False)
    return panel.imshow(values, aspect="auto", cmap=colormaps["RdBu_r"], vmin=-_RANGE, vmax=_RANGE)
