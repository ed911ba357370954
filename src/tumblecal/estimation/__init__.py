"""From a chain and data to an estimate: problem, exact fit, harmonics, Kalman filter, identifiability."""

from tumblecal.estimation.fit import Code, Fit
from tumblecal.estimation.methods import Calibrated, calibrate
from tumblecal.estimation.position_problem import default_chain, problem_of, where_of
from tumblecal.estimation.problem import Problem


__all__ = [
    "Calibrated",
    "Code",
    "Fit",
    "Problem",
    "calibrate",
    "default_chain",
    "problem_of",
    "where_of",
]
