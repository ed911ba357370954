"""From a chain and data to an estimate: problem, exact fit, harmonics, Kalman filters, identifiability."""

from tumblecal.estimation.fit import Code, Fit
from tumblecal.estimation.problem import Problem, default_chain, problem_of, where_of


__all__ = [
    "Code",
    "Fit",
    "Problem",
    "default_chain",
    "problem_of",
    "where_of",
]
