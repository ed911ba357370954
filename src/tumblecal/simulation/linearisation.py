"""Errors of the linearised fit, for any chain and plan."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain, Where
from tumblecal.estimation.problem import Problem
from tumblecal.simulation.chain_fit import design


def linearisation_error(
    chain: Chain, where: Where, sizes: Sequence[float] | float, *, draws: int = 256, seed: int = 0
) -> Float[np.ndarray, "sizes free"]:
    """Root mean square error of the parameters by a linear fit without noise, for instruments of different size.

    The linear fit is one Gauss-Newton step from the values of the chain. The exact fit has no error here, so that what is
    returned is due to the linearisation alone; it grows with the square of the size.

    **Arguments:**

    - `chain`, `where`: model and plan. `sizes`: standard deviations of all parameters about the values of the chain, base units
      (rad, g, 1). `draws`: instruments for each size. `seed`: of the draws, the same directions for each size.

    **Returns:** (sizes, free), base units, in the order of `chain.names`.

    **Raises:** `InputError` for a plan that leaves parameters undetermined.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.chain import nominal_chain, settings
        >>> from tumblecal.simulation import linearisation_error
        >>> where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))
        >>> small, large = linearisation_error(nominal_chain(where), where, [1e-4, 1e-3])
        >>> bool(np.all(abs(large / small / 100 - 1) < 0.05))  # ten times the size, a hundred times the error
        True
    """
    problem = Problem.from_arrays(chain, where, np.zeros((len(where.alpha), 3)), noise_sd=1e-3).bare
    jacobian, _ = design(problem)
    centre = jnp.asarray(chain.vector)
    towards = jnp.asarray(np.linalg.pinv(jacobian))
    predicted = problem.predicted(centre)

    def error(vector):
        return -towards @ problem.rows(predicted - problem.predicted(vector)) - (vector - centre)

    directions = jax.random.normal(jax.random.key(seed), (draws, len(centre)))
    errors = jax.jit(jax.vmap(error))
    squares = [
        np.mean(np.asarray(errors(centre[None] + size * directions)) ** 2, axis=0) for size in np.atleast_1d(sizes)
    ]
    return np.sqrt(np.stack(squares))
