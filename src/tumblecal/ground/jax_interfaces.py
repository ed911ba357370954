"""The interfaces of JAX that its documentation does not promise; no other module uses any of them.

`TESTED`: the lowest and the newest version of JAX that CI tests; the lowest is also the lower limit in `pyproject.toml`.
"""

import logging
from collections.abc import Callable
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
