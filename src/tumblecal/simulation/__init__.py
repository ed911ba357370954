"""Simulation: experiments, position means, many fits, coverage of intervals, errors of linear fits."""

from tumblecal.simulation.coverage import coverage
from tumblecal.simulation.linearisation import linearisation_error
from tumblecal.simulation.many_fits import ManyFits, fit_many, monte_carlo, sweep


__all__ = ["ManyFits", "coverage", "fit_many", "linearisation_error", "monte_carlo", "sweep"]
