"""JSON files: contents, faults with their line, no repeated keys."""

import json
from pathlib import Path
from typing import Any

from tumblecal.ground.errors import InputError
from tumblecal.ground.plain_text import controls_in
from tumblecal.ground.text_file import read_text, shown


def read_json(path: Path) -> object:
    """The content of a JSON file.

    **Raises:** `InputError` for a file that cannot be read or is not JSON, a repeated key in an object, and
    texts with control characters.
    """
    return json_of(path, read_text(path, "JSON"))


def json_of(path: Path, text: str) -> object:
    """The content of the text of a JSON file.

    **Raises:** `InputError` as `read_json` does.
    """
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


def require_plain(content: object) -> None:
    """Reject texts with control characters (escapes in JSON) in the content of a file.

    **Raises:** `InputError` naming the keys.
    """
    if (at := next(controls_in(content), None)) is not None:
        raise InputError(f"{at}: the text has control characters; remove them")


def read_json_object(path: Path) -> dict[str, Any]:
    """The object in a JSON file.

    **Raises:** `InputError` as `read_json` does, and for a file with a different content.
    """
    content = read_json(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: not a JSON object")
    return content


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
