"""Figure of the harmonics of the spindle angle in the residuals, in standard deviations under a correct model."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.residuals import Discrepancy, discrepancies
from tumblecal.estimation.fit import Fit
from tumblecal.report.drawing import INK, new_figure


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
    figure = new_figure(7.5, len(fits) * (0.2 * len(settings) + 0.55) + 0.75)
    figure.get_layout_engine().set(hspace=0.12)  # type: ignore[union-attr]
    panels = figure.subplots(len(fits), 3, sharex=True, sharey=True, squeeze=False)
    image = None
    for row, ((name, _), of_fit) in enumerate(zip(fits, cells, strict=True)):
        for panel, axis in zip(panels[row], "xyz", strict=True):
            image = _table(panel, [harmonic for harmonic in of_fit if harmonic.axis == axis], settings, columns)
            panel.set_title(f"axis {axis}, {name}")
            panel.set_xticks(range(len(columns)), [_words(*column) for column in columns], fontsize=6.5)
            panel.set_yticks(
                range(len(settings)), [f"{_beta(diagnosis, setting):g}" for setting in settings], fontsize=7
            )
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
            ink = "white" if abs(harmonic.in_sd) > 0.62 * _RANGE else INK
            panel.text(
                cell[1],
                cell[0],
                words if abs(harmonic.in_sd) < 999 else ">999" if harmonic.in_sd > 0 else "<-999",
                ha="center",
                va="center",
                fontsize=5.5,
                color=ink,
                fontweight="bold" if strong else "normal",
            )
    for side in panel.spines.values():
        side.set_visible(False)
    panel.grid(visible=False)
    return panel.imshow(values, aspect="auto", cmap=colormaps["RdBu_r"], vmin=-_RANGE, vmax=_RANGE)


def _words(order: int, wave: str) -> str:
    return "mean" if order == 0 else f"{wave[0]}{order}"


def _beta(diagnosis: Diagnosis, setting: int) -> float:
    return float(diagnosis.data.pitch_setting_deg[np.asarray(diagnosis.problem.where.index("pitch")) == setting][0])
