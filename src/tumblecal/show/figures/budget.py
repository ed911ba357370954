"""Figure of an uncertainty budget: the share of each input."""

from itertools import cycle

import numpy as np
from matplotlib.figure import Figure

from tumblecal.budget.budget import Budget
from tumblecal.show.figures.drawing import COLOURS, MUTED, new_rows, with_legend


def shares_figure(budget: Budget) -> Figure:
    """Share of each contribution in the variance of each parameter."""
    shown = budget.fit.shared
    shares = 100 * (budget.table[:, shown] / budget.combined[shown]) ** 2
    figure, panel = new_rows([budget.names[j] for j in shown], 0.24, "share of the variance / %")
    ends = np.cumsum(shares, axis=0)
    for label, share, end, colour in zip(budget.sources, shares, ends, cycle((MUTED, *COLOURS)), strict=False):
        panel.barh(range(len(shown)), share, left=end - share, label=label, color=colour, height=0.7)
    panel.set_xlim(0, 100)
    return with_legend(figure, 1, "outside right center")
