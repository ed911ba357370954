"""From a chain and data to an estimate: problem, exact fit, harmonics, Kalman filters, identifiability."""

from tumblecal.estimation.exact import fit as fit
from tumblecal.estimation.problem import (
    Problem as Problem,
    default_chain as default_chain,
    problem_of as problem_of,
    where_of as where_of,
)
from tumblecal.estimation.result import Code as Code, Result as Result
