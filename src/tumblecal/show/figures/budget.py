"""The figure of an uncertainty budget."""

import numpy as np
from matplotlib.figure import Figure

from tumblecal.budget.budget import Budget
from tumblecal.report.drawing import INK, new_figure


_COLOURS = ("#b8b8b8", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442", "#7a5195")


def shares_figure(budget: Budget) -> Figure:
    """Share of each contribution in the variance of each parameter."""
    places = budget.fit.shared
    shares = 100 * np.vstack([budget.type_a, budget.sizes])[:, places] ** 2 / budget.combined[places] ** 2
    figure = new_figure(7.5, 0.24 * len(places) + 1.2)
    axis = figure.subplots()
    ends = np.cumsum(shares, axis=0)
    rows = np.arange(len(places))
    for k, label in enumerate(budget.sources):
        axis.barh(rows, shares[k], left=ends[k] - shares[k], label=label, color=_COLOURS[k % len(_COLOURS)], height=0.7)
    axis.set_yticks(rows, [budget.names[j] for j in places])
    axis.invert_yaxis()
    axis.grid(axis="y", visible=False)
    axis.set_axisbelow(True)
    axis.set_xlim(0, 100)
    axis.set_xlabel("share of the variance / %", color=INK)
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
