"""Simulation: experiments, position means, many fits."""

from tumblecal.simulation.many_fits import ManyFits, fit_many, monte_carlo, sweep


__all__ = ["ManyFits", "fit_many", "monte_carlo", "sweep"]
