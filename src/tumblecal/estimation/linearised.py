"""A problem linearised at a vector, the descent to its least-squares estimate, and whether the design determines it."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.estimation.identifiability import Identifiability, identifiability
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.programs import cached_program


# Share of the scaled parameters (absolute below 1) below which a step is the last one.
TOLERANCE = 1e-10
MOST_STEPS = 64
# Damping of the first step, and its factors after a step that was kept and one that was not.
_DAMPING, _LESS, _MORE = 1e-3, 0.2, 5.0


class Point(NamedTuple):
    """A parameter vector, the white residual there, its Jacobian by the scaled parameters, and the steps that led there."""

    vector: Float[np.ndarray, " free"]
    rows: Float[np.ndarray, " rows"]
    jacobian: Float[np.ndarray, "rows free"]
    steps: int = 0

    @property
    def finite(self) -> bool:
        """Whether all its numbers are finite."""
        return all(bool(np.all(np.isfinite(part))) for part in self[:3])


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


def point_at(problem: Problem, vector: Float[np.ndarray, " free"], steps: int = 0) -> Point:
    """The problem linearised at a vector, as numpy arrays."""
    rows, jacobian = map(np.asarray, linearised(problem, vector))
    return Point(vector, rows, jacobian, steps)


def descended(problem: Problem, start: Point, *, damped: bool = False) -> Point:
    """The end of a descent: Gauss-Newton (Nocedal and Wright 2006, 10.3), or with damping (Levenberg and Marquardt) steps that
    reduce the sum of squares. It may not have converged.

    **Arguments:**

    - `problem`: without what no computation needs (`Problem.bare`).
    """
    point, damping = start, _DAMPING if damped else 0.0
    size = len(point.vector)
    for steps in range(1, MOST_STEPS * (8 if damped else 1) + 1):
        if not point.finite:
            break
        rows, jacobian = point.rows, point.jacobian
        if damped:
            rows = np.concatenate([rows, np.zeros(size)])
            jacobian = np.vstack([jacobian, np.sqrt(damping) * np.linalg.norm(jacobian) * np.eye(size)])
        step = np.linalg.lstsq(jacobian, rows, rcond=None)[0]
        after = point_at(problem, point.vector - step * problem.scales, steps)
        better = not damped or (after.finite and after.rows @ after.rows <= point.rows @ point.rows)
        point, damping = (after, damping * _LESS) if better else (point._replace(steps=steps), damping * _MORE)
        if np.all(np.abs(step) <= TOLERANCE * (1.0 + np.abs(point.vector / problem.scales))):
            break
    return point


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
