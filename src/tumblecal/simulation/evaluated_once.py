"""Batched programs for the CPU in which every sine, root and logarithm is evaluated once.

XLA's compiler for the CPU fuses elementwise work into every consumer of it, so the sines of a chain are evaluated again for
each of the sums of its gradient: half of the time of a fit. Sums over groups of positions, the derivative of a parameter for
each pitch setting, are matrix products here, because its scatter adds one index after the other.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import Jaxpr, Literal
from jax.lax import GatherScatterMode
from jaxtyping import Array, Float


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

    def evaluated(*arguments):
        traced, shape = jax.make_jaxpr(function, return_shape=True)(*arguments)
        results = _run(traced.jaxpr, traced.consts, jax.tree.leaves(arguments), lanes)
        return jax.tree.unflatten(jax.tree.structure(shape), results)

    return evaluated


def _run(program: Jaxpr, constants: Sequence[Any], arguments: Sequence[Any], lanes: int) -> list[Any]:
    """The results of a traced program, operation by operation."""
    known: dict[Any, Any] = dict(zip((*program.constvars, *program.invars), (*constants, *arguments), strict=True))
    for operation in program.eqns:
        inputs = [part.val if isinstance(part, Literal) else known[part] for part in operation.invars]
        primitive, options = operation.primitive, operation.params
        # A call: of a compiled function, or of one with a derivative of its own, which is not needed any more.
        called = options.get("jaxpr" if primitive.name in ("jit", "pjit") else "call_jaxpr")
        if called is not None:
            results = _run(called.jaxpr, called.consts, inputs, lanes)
        elif primitive.name == "scatter-add" and _by_groups(options, *inputs):
            results = [_group_sums(options["dimension_numbers"], *inputs)]
        else:
            results = primitive.bind(*inputs, **options)
            results = list(results) if primitive.multiple_results else [results]
        if primitive.name in _SLOW:
            results = [_in_memory(result, lanes) for result in results]
        known |= dict(zip(operation.outvars, results, strict=True))
    return [part.val if isinstance(part, Literal) else known[part] for part in program.outvars]


def _by_groups(options: Mapping[str, Any], target: Array, index: Array, parts: Array) -> bool:
    """Whether a scatter adds whole slices along one axis of the target, each to the place in a list."""
    numbers = options["dimension_numbers"]
    if index.ndim != 2 or len(numbers.scatter_dims_to_operand_dims) != 1 or numbers.operand_batching_dims:
        return False
    (axis,) = numbers.scatter_dims_to_operand_dims
    slices = tuple(parts.shape[k] for k in numbers.update_window_dims)
    whole = slices == target.shape[:axis] + target.shape[axis + 1 :] and numbers.inserted_window_dims == (axis,)
    return whole and options["mode"] != GatherScatterMode.CLIP


def _group_sums(numbers: Any, target: Array, index: Array, parts: Array) -> Array:
    """The target with the parts added, by a product with the matrix of the groups' members."""
    (axis,) = numbers.scatter_dims_to_operand_dims
    (listed,) = set(range(parts.ndim)) - set(numbers.update_window_dims)
    members = jnp.asarray(jnp.arange(target.shape[axis], dtype=index.dtype)[:, None] == index[:, 0], parts.dtype)
    return target + jnp.moveaxis(jnp.tensordot(members, parts, ((1,), (listed,))), 0, axis)


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
