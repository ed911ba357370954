"""A problem linearised at a vector: weighted residual, its Jacobian by scaled parameters, and whether these determine all."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.estimation.identifiability import Identifiability, identifiability
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.programs import cached_program


@jax.jit
def scaled_residual(problem: Problem, scaled: Float[Array, " free"]) -> Float[Array, " rows"]:
    """Residual by scaled parameters. Compiled separately, so that a solver traces the chain only once."""
    return problem.residual(scaled * jnp.asarray(problem.scales))


def linearised(problem: Problem, vector: Float[Array | np.ndarray, " free"]) -> tuple[Array, Array]:
    """Weighted residual and its Jacobian by the scaled parameters, at a parameter vector."""
    return _linearised(problem.bare, vector)


@cached_program
def _linearised(problem: Problem, vector: Float[Array, " free"]) -> tuple[Array, Array]:
    scaled = vector / jnp.asarray(problem.scales)
    residual, push = jax.linearize(partial(scaled_residual, problem), scaled)
    return residual, jax.vmap(push, out_axes=-1)(jnp.eye(len(scaled)))


def identifiability_of(problem: Problem, jacobian: Float[np.ndarray, "rows free"]) -> Identifiability:
    """What a Jacobian of a problem, as of `linearised`, determines."""
    return identifiability(jacobian, problem.chain.names, problem.scales, problem.chain.of_positions)


def require_full_rank(problem: Problem, jacobian: Float[np.ndarray, "rows free"], source: str | None = None) -> None:
    """Reject a problem with undetermined directions.

    **Arguments:**

    - `jacobian`: as of `linearised`. `source`: named in the message; the file of the data if omitted.

    **Raises:** `InputError` that names the directions and the remedies.
    """
    identifiability_of(problem, jacobian).require_full_rank(source or problem.source, np.asarray(problem.readings))
