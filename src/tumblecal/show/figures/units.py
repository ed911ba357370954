"""Figure of units on one head: the common errors as each unit shows them."""

from matplotlib.figure import Figure

from tumblecal.diagnosis.units import JointDiagnosis
from tumblecal.diagnosis.units.record import head_sizes
from tumblecal.effects import Catalogue
from tumblecal.show.figures.drawing import INK, OUTSIDE, new_panels, noise_band


def shared_figure(found: JointDiagnosis, entries: Catalogue) -> Figure | None:
    """Estimates of the common errors by each unit; None if there are none."""
    if not found.shared:
        return None
    common = head_sizes(found, entries)
    names = [name for signal in found.shared for name in signal.slot.names]
    figure, panels = new_panels(1.0 + 1.5 * len(names), len(names), sharex=True)
    for name, panel in zip(names, panels[:, 0], strict=True):
        noise_band(panel, 2 * (common[name].sd or 0.0), middle=common[name].value)
        for number in range(len(found.batch.units)):
            if size := head_sizes(found, entries, number).get(name):
                face = OUTSIDE if number in found.outlying else "white"
                panel.errorbar(number + 1, size.value, size.sd, fmt="o", color=INK, mfc=face, lw=0.9)
        panel.set_ylabel(f"{name}\n{common[name].unit}")
    last = panels[-1, 0]
    last.locator_params(axis="x", integer=True)
    last.set_xlabel("unit, in the order of the files")
    return figure
