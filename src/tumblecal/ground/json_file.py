"""JSON files: contents, faults with their line, no repeated keys."""

import json
from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel
from pydantic_core import to_json

from tumblecal.ground.errors import InputError
from tumblecal.ground.plain_text import controls_in
from tumblecal.ground.text_file import read_text, shown


def read_json(path: Path) -> object:
    """The content of a JSON file.

    **Raises:** `InputError` for a file that cannot be read or is not JSON, a repeated key in an object, and
    texts with control characters.
    """
    text = read_text(path, "JSON")
    try:
        content = json.loads(text, object_pairs_hook=without_repeats)
        require_plain(content)
        return content
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path}:line {error.lineno}, column {error.colno}: not JSON: {error.msg}") from error
    except RecursionError as error:
        raise InputError(f"{path}: JSON nested too deeply to read") from error
    except ValueError as error:  # an integer of thousands of digits
        raise InputError(f"{path}: not JSON: {error}") from error


def json_text(content: BaseModel | Mapping[str, object]) -> str:
    """A record, or numbers, arrays, lists, texts and dataclasses, as the text of a JSON file; numbers that are not finite
    become null."""
    return to_json(content, indent=1, inf_nan_mode="null", fallback=lambda array: array.tolist()).decode() + "\n"


def require_plain(content: object) -> None:
    """Reject texts with control characters (escapes in JSON) in the content of a file.

    **Raises:** `InputError` naming the keys.
    """
    if (at := next(controls_in(content), None)) is not None:
        raise InputError(f"{at}: the text has control characters; remove them")


def without_repeats(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """The content of a JSON object, for `json.loads`, which would keep only the last value of a repeated key.

    **Raises:** `InputError` for such a key.
    """
    content = dict(pairs)
    if len(content) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in content if keys.count(key) > 1)
        raise InputError(f"the key {shown(twice)} is given twice in one object; remove one of them")
    return content
