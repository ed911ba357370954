"""Figures and pages supplement results: an error in one costs neither the results nor the others."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tumblecal.ground.errors import InputError, SupplementWarning, one_line
from tumblecal.ground.result_set import final_place


@contextmanager
def supplement(name: str | Path) -> Iterator[None]:
    """A block that draws a figure or writes a page; an error in it is a `SupplementWarning`, which tests turn into an error.

    **Arguments:**

    - `name`: path of the figure or page, or its name in words.
    """
    try:
        yield
    except Exception as error:
        logging.getLogger(__name__).debug("%s", name, exc_info=True)
        reason = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
        words = f"{final_place(Path(name))} is missing or incomplete ({one_line(reason)}); the results are complete"
        warnings.warn(SupplementWarning(words), stacklevel=3)
