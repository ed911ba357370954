"""What checks shapes and types at run time: beartype in jaxtyping's context, with an int wherever a float may stand (PEP 484).

jaxtyping's own decorator binds the arguments of every call in Python, twice as long as both checks take: it tells better which
argument was wrong.
"""

import dataclasses
from collections.abc import Callable
from functools import partial, wraps
from inspect import isgeneratorfunction
from types import FunctionType
from typing import Any, get_type_hints

import jaxtyping
from beartype import BeartypeConf, beartype


_CONF = BeartypeConf(is_pep484_tower=True, violation_type=jaxtyping.TypeCheckError)
_theirs = jaxtyping.jaxtyped


def begin() -> None:
    """Let what jaxtyping's import hook decorates be checked so."""
    jaxtyping.jaxtyped = jaxtyped


def checked(function: Callable) -> Callable:
    """The function with its annotations checked."""
    return beartype(function, conf=_CONF)


def jaxtyped(decorated: Any = None, *, typechecker: Any) -> Any:
    if decorated is None:
        return partial(jaxtyped, typechecker=typechecker)
    if dataclasses.is_dataclass(decorated):
        if isinstance(decorated.__init__, FunctionType) and not hasattr(decorated.__init__, "__wrapped__"):
            decorated.__init__ = _within_context(decorated.__init__)
        return decorated
    if isinstance(decorated, FunctionType) and not isgeneratorfunction(decorated):
        return _within_context(decorated)
    return _theirs(decorated, typechecker=typechecker)


def _within_context(function: Callable) -> Callable:
    """The function checked, the sizes of its arguments and of what it returns compared with each other alone."""
    function.__annotations__ = {name: _known(hint, function) for name, hint in function.__annotations__.items()}
    inner, context = checked(function), _theirs("context")

    @wraps(function)
    def within(*arguments, **options):
        with context:
            return inner(*arguments, **options)

    return within


def _known(hint: Any, function: Callable) -> Any:
    """An annotation with the names in it looked up; `Any` where one of them is for type checkers alone, or not made yet."""

    def annotated(value: hint):
        del value

    try:
        return get_type_hints(annotated, function.__globals__, include_extras=True)["value"]
    except Exception:  # of whatever kind: some hints are for people alone
        return Any
