"""A user's script: angles by gradient."""

import numpy as np

from tumblecal import Problem, enable_float64
from tumblecal.chain import nominal_chain, settings
from tumblecal.planning import optimise_plan


enable_float64()
where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))
problem = Problem.from_arrays(nominal_chain(where), where, np.zeros((24, 3)), noise_sd=1e-4)
plan = optimise_plan(problem, parameters=["dK_x", "bias_x"], steps=20)
print(dict(zip(plan.names, (plan.sd_after / plan.sd_before).tolist(), strict=True)), plan.where.alpha)
