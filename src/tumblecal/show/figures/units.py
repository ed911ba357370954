"""Figure of units on one head: the estimate of the common errors by each unit."""

from matplotlib.figure import Figure

from tumblecal.diagnosis.units import JointDiagnosis
from tumblecal.diagnosis.units.sizes import head_sizes
from tumblecal.effects import Catalogue
from tumblecal.report.drawing import INK, MUTED, OUTSIDE, new_figure


_MOST_PANELS = 6


def shared_figure(found: JointDiagnosis, entries: Catalogue) -> Figure | None:
    """A panel for each coefficient; None if there are no common errors."""
    names = [name for signal in found.shared for name in signal.slot.names][:_MOST_PANELS]
    if not names:
        return None
    common = head_sizes(found, entries)
    estimates = [head_sizes(found, entries, number) for number in range(len(found.batch.units))]
    figure = new_figure(7.5, 1.0 + 1.5 * len(names))
    panels = figure.subplots(len(names), 1, squeeze=False, sharex=True)[:, 0]
    for name, panel in zip(names, panels, strict=True):
        value, sd = common[name]["value"], common[name]["sd"]
        panel.axhspan(value - 2 * sd, value + 2 * sd, color=MUTED, alpha=0.25, lw=0)
        panel.axhline(value, color=INK)
        for number, sizes in enumerate(estimates):
            if size := sizes.get(name):
                face = OUTSIDE if number in found.outlying else "white"
                panel.errorbar(number + 1, size["value"], size["sd"], fmt="o", ms=4, color=INK, mfc=face, lw=0.9)
        panel.set_ylabel(f"{name}\n{common[name]['unit']}")
    panels[-1].xaxis.get_major_locator().set_params(integer=True)
    panels[-1].set_xlabel("unit, in the order of the files")
    return figure
