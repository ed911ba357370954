"""Programs of arrays that JAX compiles, within limits of memory: equal ones once in a process.

JAX stores the compiled programs of a command on disk (`ground.program_cache`), so a further process only traces.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from types import CodeType
from typing import Any

import jax
import numpy as np
from jax.core import Tracer


# A program for one plan runs a few times, for milliseconds, but takes seconds to compile. XLA's fusion emitters for the CPU
# recompute a chain of 60 links repeatedly: 30 ms instead of 1 ms (jax 0.10.2). Without LLVM's optimisation the
# compilation takes a third of the time; without a split for several cores the program then runs equally fast.
_QUICKLY_COMPILED = {
    "xla_cpu_use_fusion_emitters": False,
    "xla_backend_optimization_level": 0,
    "xla_cpu_parallel_codegen_split_count": 1,
}
_OPTIMISED = {"xla_backend_optimization_level": 2}
# A compiled program takes 5 to 20 MB. Limits in memory: kinds of arguments of one function, and functions that are about
# something. Those beyond are compiled again.
_MOST_KINDS, _MOST_FUNCTIONS = 8, 32


@lru_cache
def compiler_options(optimised: bool = False) -> dict[str, Any]:
    """XLA's options for programs of one plan; empty if not on the CPU, or if this version of XLA lacks them.

    `optimised`: for one that runs for longer than its compilation takes.
    """
    if jax.default_backend() != "cpu":
        return {}
    options = _QUICKLY_COMPILED | (_OPTIMISED if optimised else {})
    try:
        jax.jit(lambda x: x + 1.0, compiler_options=options)(1.0)
    except RuntimeError:
        return {}
    return options


def cached_program(function: Callable[..., Any], *about: Any, optimised: bool = False) -> Callable[..., Any]:
    """`jax.jit(function)` for a function of pytrees of arrays; the last few kinds of arguments stay compiled.

    **Arguments:**

    - `function`: of a module, or one that closes over nothing but `about`: chains, arrays, plain values. Equal ones are one
      program.
    - `optimised`: compiled to run for longer than the compilation takes.
    """
    leaves, structure = jax.tree.flatten(about)
    arrays = [np.asarray(leaf) for leaf in leaves]
    if any(array.dtype == object for array in arrays):
        raise TypeError("a program is about chains, arrays and plain values")
    values = tuple((array.shape, array.tobytes()) for array in arrays)
    return _program(_Source(function.__code__, structure, values, function), optimised)


@dataclass(frozen=True)
class _Source:
    """A function: its code and all that it closes over."""

    code: CodeType
    structure: Any
    values: tuple
    function: Callable[..., Any] = field(compare=False)


@lru_cache(maxsize=_MOST_FUNCTIONS)
def _program(source: _Source, optimised: bool) -> Callable[..., Any]:
    traced = jax.jit(source.function)

    @lru_cache(maxsize=_MOST_KINDS)
    def of_kind(structure: Any, _shapes: tuple) -> Callable[[list], Any]:
        def of_leaves(leaves):
            return source.function(*jax.tree.unflatten(structure, leaves))

        return jax.jit(of_leaves, compiler_options=compiler_options(optimised))

    def call(*arguments):
        leaves, structure = jax.tree.flatten(arguments)
        if any(isinstance(leaf, Tracer) for leaf in leaves):
            return traced(*arguments)
        return of_kind(structure, tuple([(np.shape(leaf), getattr(leaf, "dtype", type(leaf))) for leaf in leaves]))(
            leaves
        )

    return call
