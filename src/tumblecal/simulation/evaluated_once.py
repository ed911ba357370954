"""Batched programs for the CPU in which every sine, root and logarithm is evaluated once.

XLA's compiler for the CPU fuses elementwise work into every consumer of it, so the sines of a chain are evaluated again for
each of the sums of its gradient: a third of the time of a fit.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from tumblecal.ground.jax_interfaces import with_results


_SLOW = frozenset({"sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"}) | frozenset(
    {"exp", "exp2", "expm1", "log", "log1p", "logistic", "sqrt", "rsqrt", "cbrt", "pow", "erf", "erfc"}
)
# Numbers for each product with 1: the cost is this number of multiplications for each, a tenth of a sine.
_WIDTH = 8


def evaluated_once(function: Callable[..., Any], lanes: int) -> Callable[..., Any]:
    """A function of arrays, of which those with `lanes` rows are a batch, with slow functions of the batch evaluated once.

    On devices other than the CPU it is the function as it is.
    """
    if jax.default_backend() != "cpu":
        return function

    def stored(operation, result):
        return _in_memory(result, lanes) if operation in _SLOW else result

    return with_results(function, stored)


def _in_memory(batch: Array, lanes: int) -> Array:
    """The same numbers, put in memory if they are a batch of lanes."""
    if batch.ndim < 2 or batch.shape[0] != lanes or batch.size == 0:
        return batch
    # Each row of a product belongs to one lane: what is not finite remains in its lane.
    count = batch.size // lanes
    rows = jnp.pad(batch.reshape(lanes, count), ((0, 0), (0, -count % _WIDTH)))
    stored = rows.reshape(-1, _WIDTH) @ jnp.eye(_WIDTH, dtype=batch.dtype)
    return stored.reshape(lanes, -1)[:, :count].reshape(batch.shape)


def materialised(rows: Float[Array, "rows lanes"]) -> Float[Array, "rows lanes"]:
    """The same numbers, put in memory.

    The compiler fuses elementwise work into every consumer and would repeat a whole fit for each of the sums made of
    it; a matrix product (here with 1) is where fusion ends. Its optimisation barrier does not do that on CPUs.
    """
    return jnp.eye(rows.shape[0]) @ rows
