"""A description of everything that a traced program depends on, the same in every process."""

import dataclasses
import hashlib
import linecache
import types
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from tumblecal.chain import Parameter


def described(value: Any) -> Iterator[str]:
    """A tree of modules, containers, arrays, functions and plain values, as a sequence of texts.

    Value and typical size of a free parameter are omitted, because a program takes them as arguments. A function is
    described by its code, file, defaults and closure, because its address differs between processes.

    **Raises:** `TypeError` for a value without such a description.
    """
    if isinstance(value, types.FunctionType):
        yield f"{value.__module__}.{value.__qualname__}"
        yield _digest_of_file(value.__code__.co_filename)
        yield from described(value.__code__)
        yield from described(value.__defaults__)
        yield from described(tuple(cell.cell_contents for cell in value.__closure__ or ()))
    elif hasattr(value, "__wrapped__"):
        yield from described(value.__wrapped__)
    elif isinstance(value, types.CodeType):
        # The constants include the code of inner functions.
        yield value.co_code.hex()
        yield repr(value.co_names)
        yield from described(value.co_consts)
    elif isinstance(value, Parameter) and value.free:
        parts = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        yield from described(parts | {"value": np.shape(value.value), "scale": None})
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield f"{type(value).__module__}.{type(value).__qualname__}"
        yield from described({field.name: getattr(value, field.name) for field in dataclasses.fields(value)})
    elif isinstance(value, dict):
        yield from described(tuple(value.items()))
    elif isinstance(value, (tuple, list)):
        yield f"{type(value).__qualname__} of {len(value)}"
        for part in value:
            yield from described(part)
    elif hasattr(value, "dtype"):
        array = np.asarray(value)
        yield f"{array.dtype} {array.shape} {array.tobytes().hex()}"
    elif value is None or isinstance(
        value, (str, bytes, int, float, complex, type, types.BuiltinFunctionType, np.ufunc)
    ):
        yield f"{type(value).__qualname__} {value!r}"
    else:
        raise TypeError(f"a program that depends on {type(value).__qualname__} {value!r} is not stored")


def _digest_of_file(path: str) -> str:
    # The cache of lines also contains the cells of a notebook, which are not files.
    linecache.checkcache(path)
    lines = tuple(linecache.getlines(path))
    if not lines:
        raise TypeError(f"a program that depends on a function of {path}, which cannot be read, is not stored")
    return _digest_of_lines(lines)


@lru_cache
def _digest_of_lines(lines: tuple[str, ...]) -> str:
    return hashlib.sha256("".join(lines).encode()).hexdigest()
