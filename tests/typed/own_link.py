"""A user's script: a link of one's own."""

import numpy as np

import tumblecal
from tumblecal import Link, Problem
from tumblecal.chain import Parameter, Place, State, Where, coefficients, nominal_chain, settings


tumblecal.enable_float64()


class Cubic(Link):
    """A third-order term of the output y."""

    place = Place.OUTPUT
    k: Parameter

    def __call__(self, state: State, where: Where) -> State:
        """The state with the term."""
        x, y, z = state.reading
        (k,) = self.k.at(where)
        return State(state.alpha, state.beta, state.f, (x, y + k * state.f[1] ** 3, z))


where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))
chain = nominal_chain(where) + Cubic(coefficients("cubic", unit="1", scale=1e-4))
fit = tumblecal.fit(Problem.from_arrays(chain, where, chain(where), noise_sd=1e-4))
print(chain.names[-1], fit.value("cubic"))
