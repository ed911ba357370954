"""What checks shapes and types at run time: beartype, with an int wherever a float may stand (PEP 484)."""

from collections.abc import Callable
from typing import Any

from beartype import BeartypeConf, beartype


def checked(function: Callable) -> Callable:
    """The function with its annotations checked.

    jaxtyping makes two of each function, of which the second says what is returned: its arguments passed a moment ago,
    in the first, whose sizes still stand.
    """
    returned = function.__annotations__.get("return", Any)
    if returned is not Any:
        function.__annotations__ = {"return": returned}
    return beartype(function, conf=_CONF)


_CONF = BeartypeConf(is_pep484_tower=True)
