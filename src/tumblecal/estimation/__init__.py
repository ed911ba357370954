"""From a chain and data to an estimate: problem, exact fit, harmonics, Kalman filters, identifiability."""

from tumblecal.estimation.fit import Code as Code
from tumblecal.estimation.fit import Fit as Fit
from tumblecal.estimation.problem import Problem as Problem
from tumblecal.estimation.problem import default_chain as default_chain
from tumblecal.estimation.problem import problem_of as problem_of
from tumblecal.estimation.problem import where_of as where_of
