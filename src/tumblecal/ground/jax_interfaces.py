"""The interfaces of JAX that its documentation does not promise; no other module uses any of them.

`TESTED`: the lowest and the newest version of JAX that CI tests; the lowest is also the lower limit in `pyproject.toml`.
"""

import logging
from collections.abc import Callable, Sequence
from typing import Any


TESTED = ("0.10.2", "0.12.0.1")

_log = logging.getLogger("tumblecal.program_cache")


def store_executables_in(cache: Any, folder: str) -> bool:
    """Make JAX store its compiled programs in `cache` (methods `get` and `put`, attribute `_path`) instead of plain files of
    `folder`; in none if `cache` is None.

    **Returns:** whether it does; not with a version of JAX without this interface, which then stores none.
    """
    try:
        from jax._src import compilation_cache

        reset: Callable[[], None] = compilation_cache.reset_cache
        _ = compilation_cache.get_file_cache
    except (ImportError, AttributeError) as error:
        _log.debug("JAX keeps no executables: %s", error)
        return False
    reset()
    compilation_cache.get_file_cache = lambda path: None if cache is None else (cache, folder)  # type: ignore
    return cache is not None


def with_results(function: Callable[..., Any], changed: Callable[[str, Any], Any]) -> Callable[..., Any]:
    """`function` of pytrees of arrays, with `changed(operation, result)` in place of each result of an operation of JAX.

    Operations within loops and branches stay as they are; a derivative that a part of the function defines is lost.
    """
    import jax

    def evaluated(*arguments):
        program, shape = jax.make_jaxpr(function, return_shape=True)(*arguments)
        results = _run(program, jax.tree.leaves(arguments), changed)
        return jax.tree.unflatten(jax.tree.structure(shape), results)

    return evaluated


def _run(program: Any, arguments: Sequence[Any], changed: Callable[[str, Any], Any]) -> list[Any]:
    """The results of a traced program, operation by operation."""
    variables = (*program.jaxpr.constvars, *program.jaxpr.invars)
    known = dict(zip(variables, (*program.consts, *arguments), strict=True))

    def values(parts):
        # A literal has its value; a variable has none.
        return [part.val if hasattr(part, "val") else known[part] for part in parts]

    for operation in program.jaxpr.eqns:
        inputs, name, options = values(operation.invars), operation.primitive.name, operation.params
        # A call: of a compiled function, or of one with a derivative of its own.
        called = options.get("jaxpr" if name in ("jit", "pjit") else "call_jaxpr")
        if called is not None:
            results = _run(called, inputs, changed)
        else:
            results = operation.primitive.bind(*inputs, **options)
            results = [changed(name, part) for part in (results if operation.primitive.multiple_results else [results])]
        known |= dict(zip(operation.outvars, results, strict=True))
    return values(program.jaxpr.outvars)
