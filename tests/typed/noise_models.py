"""A user's script: the noise of means and its use in a fit."""

import numpy as np

import tumblecal
from tumblecal import Problem
from tumblecal.chain import nominal_chain, settings
from tumblecal.noise import Covariance, Flicker, Noise, White, regular_dwells


tumblecal.enable_float64()
noise = Noise((White(np.full(3, 60e-6)), Flicker(np.full(3, 20e-6))))
covariance = noise.mean_covariance(regular_dwells(24, 30.0, 20.0, 125.0))
where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))
chain = nominal_chain(where)
fit = tumblecal.fit(Problem.from_arrays(chain, where, chain(where), noise=Covariance.by_axis(covariance)))
print(fit.sd, fit.correlation.shape)
