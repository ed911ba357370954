"""TOML files that people write: read strictly, all faults told at once."""

import tomllib
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from tumblecal.errors import InputError


class Strict(BaseModel):
    """A table of a TOML file: no unknown keys, no silent conversions, not changed after reading."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


Table = TypeVar("Table", bound=BaseModel)


def read_toml(path: Path, table: type[Table]) -> Table:
    """Read and check a TOML file.

    **Raises:** `InputError`, one line a fault, with dotted paths.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a TOML file ({error})") from error
    try:
        return table.model_validate(content)
    except ValidationError as error:
        raise InputError([_line(path, fault) for fault in error.errors()]) from error


def _line(path: Path, fault: ErrorDetails) -> str:
    own_words = {"missing": "is missing; add it", "extra_forbidden": "unknown key; remove it or check its spelling"}
    where = ".".join(str(part) for part in fault["loc"]) or "file"
    given = "" if isinstance(fault["input"], dict) else f" (got {fault['input']!r})"
    return f"{path}: {where}: {own_words.get(fault['type'], fault['msg'].removeprefix('Value error, ') + given)}"
