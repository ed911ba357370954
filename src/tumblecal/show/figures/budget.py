"""Figure of an uncertainty budget: the share of each input."""

import numpy as np
from matplotlib.figure import Figure

from tumblecal.budget.budget import Budget
from tumblecal.show.figures.drawing import new_panel
from tumblecal.show.figures.panels import name_rows, with_legend


TYPE_A = "noise (type A)"


def contributions_of(budget: Budget) -> list[str]:
    """Names of the contributions: the noise, parts of a diagnosis, the inputs."""
    return [TYPE_A, *budget.labels]


def shares_figure(budget: Budget) -> Figure:
    """Share of each contribution in the variance of each parameter."""
    shown = budget.fit.shared
    shares = 100 * (np.vstack([budget.type_a, budget.sizes]) / budget.combined)[:, shown] ** 2
    figure, panel = new_panel(0.24 * len(shown) + 1.2)
    ends = np.cumsum(shares, axis=0)
    for label, share, end in zip(contributions_of(budget), shares, ends, strict=True):
        panel.barh(range(len(shown)), share, left=end - share, label=label, height=0.7)
    name_rows(panel, [budget.names[j] for j in shown])
    panel.set(xlim=(0, 100), xlabel="share of the variance / %")
    return with_legend(figure, 1, "outside right center")
