"""TOML files that people write: read strictly, all faults told at once, by their dotted paths."""

import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import read_text, shown


class Strict(BaseModel):
    """A table of a TOML file: no unknown keys, no silent conversions, not changed after reading."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


def _finite(value: float) -> float:
    if abs(value) > LARGEST_NUMBER:
        raise ValueError(f"must be smaller than {LARGEST_NUMBER:g}")
    return value


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("must be one line without control characters")
    return text


# No quantity of a rig, a plan or a study comes near: beyond it squares overflow.
LARGEST_NUMBER = 1e100
Number = Annotated[float, Field(allow_inf_nan=False, strict=False), AfterValidator(_finite)]
# A label or title, which is written into one line of other files.
Line = Annotated[str, AfterValidator(_printable)]
# What random numbers start from; more does not fit into the generators' 64 bits.
LARGEST_SEED = 2**63 - 1
Seed = Annotated[int, Field(ge=0, le=LARGEST_SEED)]

Table = TypeVar("Table", bound=BaseModel)
# Names of the forms of a table that pydantic puts into a path; nobody wrote them.
_FORMS = ("list", "steps")
_Keys = tuple[int | str, ...]


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file.

    **Raises:** `InputError` when it is missing or is not TOML.
    """
    text = read_text(path, "TOML", may_be_empty=True)
    try:
        content = tomllib.loads(text)
        if faults := [f"{path}: {keys}: the integer does not fit into 64 bits" for keys in _beyond_64_bits(content)]:
            raise InputError(faults)
        return content
    except InputError:
        raise
    except RecursionError as error:
        raise InputError(f"{path}: not TOML: nested too deeply") from error
    except ValueError as error:  # TOMLDecodeError, or an integer of too many digits
        raise InputError(f"{path}: not TOML: {str(error).splitlines()[0]}") from error


def _beyond_64_bits(value: object, at: str = "") -> Iterator[str]:
    """Dotted paths of integers that TOML does not allow; Python reads them all the same."""
    if isinstance(value, dict | list):
        parts = value.items() if isinstance(value, dict) else enumerate(value)
        for key, part in parts:
            yield from _beyond_64_bits(part, f"{at}.{key}" if at else str(key))
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        yield at


def checked(path: Path, content: Mapping[str, object], table: type[Table]) -> Table:
    """The content of a file as the table it should be; `path` is named in faults.

    **Raises:** `InputError`, one line a fault, with dotted paths; of a file of another kind that alone.
    """
    stated, own = content.get("schema"), table.model_fields.get("schema_")
    wanted = get_args(own.annotation) if own else ()
    # Another version of this kind of file has faults of its own, and all are told.
    same_kind = str(stated).rpartition("/")[0] in (str(schema).rpartition("/")[0] for schema in wanted)
    if str(stated).startswith("tumblecal.") and not same_kind:
        kind = f"not {wanted[0]!r}" if wanted else "but a file without one is wanted here"
        raise InputError(f"{path}: schema is {stated!r}, {kind}; is this the right file?")
    try:
        return table.model_validate(content)
    except ValidationError as error:
        raise InputError(validation_faults(path, error)) from error


def validation_faults(path: Path, error: ValidationError) -> list[str]:
    """One line a fault of a file checked by pydantic: dotted path, what is wrong."""
    own_words = {"missing": "is missing; add it", "extra_forbidden": "unknown key; remove it or check its spelling"}
    faults, listed = [], error.errors(include_url=False)
    meant = _misspelt(
        [fault["loc"] for fault in listed if fault["type"] == "extra_forbidden"],
        [fault["loc"] for fault in listed if fault["type"] == "missing"],
    )
    for fault in listed:
        if fault["loc"] in meant.values():
            continue
        keys = ".".join(str(part) for part in fault["loc"] if part not in _FORMS) or "file"
        text = own_words.get(fault["type"])
        if fault["loc"] in meant:
            text = f"unknown key; did you mean {meant[fault['loc']][-1]}?"
        if text is None:
            got = "" if isinstance(fault["input"], dict) else f" (got {shown(fault['input'])})"
            text = fault["msg"].removeprefix("Value error, ") + got
        faults.append(f"{path}: {keys}: {text}")
    return list(dict.fromkeys(faults))


def _misspelt(unknown: Sequence[_Keys], missing: Sequence[_Keys]) -> dict[_Keys, _Keys]:
    """Which missing key of the same table an unknown one is meant for."""
    meant: dict[_Keys, _Keys] = {}
    for at in unknown:
        beside = {str(keys[-1]): keys for keys in missing if keys[:-1] == at[:-1]}
        if near := get_close_matches(str(at[-1]), beside, n=1):
            meant[at] = beside[near[0]]
    return meant


def toml_string(text: str) -> str:
    """A text as a TOML basic string; a JSON string is one, once DEL is escaped and halves of surrogates are gone."""
    return json.dumps(text.encode("utf-8", "replace").decode("utf-8"), ensure_ascii=False).replace("\x7f", "\\u007f")
