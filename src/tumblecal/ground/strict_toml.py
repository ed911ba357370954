"""TOML files of users: strict validation, all faults reported at once, with dotted paths."""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from json.encoder import encode_basestring
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag, ValidationError

from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import LARGEST_SEED, sizes
from tumblecal.ground.plain_text import controls_in
from tumblecal.ground.text_file import read_text
from tumblecal.ground.toml_faults import located, validation_faults
from tumblecal.ground.units import quantity, reading_sd


class Strict(BaseModel):
    """A table of a TOML file: no unknown keys, no silent conversions, immutable."""

    model_config: ClassVar[ConfigDict] = ConfigDict(strict=True, extra="forbid", frozen=True)


def _finite(value: float) -> float:
    if abs(value) > LARGEST_NUMBER:
        raise ValueError(f"must be smaller than {LARGEST_NUMBER:g}")
    return value


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("must be one line without control characters")
    return text


# Larger than any quantity of a rig, a plan or a study; squares of larger numbers overflow.
LARGEST_NUMBER = 1e100
Number = Annotated[float, Field(allow_inf_nan=False, strict=False), AfterValidator(_finite)]
# The discriminator determines the form, so that a fault names one form only.
Numbers = Annotated[
    Annotated[Number, Tag("number")] | Annotated[list[Number], Tag("list")],
    Discriminator(lambda given: "list" if isinstance(given, list) else "number"),
]


def _in_unit(read: Callable[[str], float]) -> BeforeValidator:
    """A text such as `0.1 mg` as a number that is not below 0."""

    def number(text: object) -> float:
        if not isinstance(text, str):
            raise ValueError("must be a text in quotation marks")
        if (value := read(text)) < 0:
            raise ValueError(f"{text!r} must not be below 0")
        return value

    return BeforeValidator(number)


# Sizes with their unit in a text, in base units: an angle, an acceleration, its rate, a time, a frequency; the standard
# deviation of a reading.
Angle = Annotated[float, _in_unit(lambda text: quantity(text, "rad"))]
Force = Annotated[float, _in_unit(lambda text: quantity(text, "g"))]
ForceRate = Annotated[float, _in_unit(lambda text: quantity(text, "g/h"))]
Seconds = Annotated[float, _in_unit(lambda text: quantity(text, "s"))]
Hertz = Annotated[float, _in_unit(lambda text: quantity(text, "Hz"))]
Sd = Annotated[float, _in_unit(reading_sd)]
SdOrNone = Annotated[float, _in_unit(lambda text: reading_sd(text, none=True))]


def sizes_by_name(units: Mapping[str, str] | Callable[[str], str], *, zero: bool = False) -> BeforeValidator:
    """A table of sizes with their unit in a text, in base units; `zero`: whether a size may be 0."""

    def read(given: object) -> dict[str, float]:
        if not isinstance(given, Mapping) or not all(isinstance(text, str) for text in given.values()):
            raise ValueError("must be a table of texts in quotation marks")
        return sizes("", given, units, zero=zero)

    return BeforeValidator(read)


# A label or title, which is one line of other files.
Line = Annotated[str, AfterValidator(_printable)]
Seed = Annotated[int, Field(ge=0, le=LARGEST_SEED)]

Table = TypeVar("Table", bound=BaseModel)


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file.

    **Raises:** `InputError` if it is missing or is not TOML.
    """
    text = read_text(path, "TOML", may_be_empty=True)
    try:
        content = tomllib.loads(text)
        if faults := [f"{path}: {keys}: the integer does not fit into 64 bits" for keys in _beyond_64_bits(content)]:
            raise InputError(faults)
        if faults := [f"{path}: {keys}: the text has control characters; remove them" for keys in controls_in(content)]:
            raise InputError(located(path, faults))
        return content
    except InputError:
        raise
    except RecursionError as error:
        raise InputError(f"{path}: not TOML: nested too deeply") from error
    except ValueError as error:  # TOMLDecodeError, or an integer of too many digits
        raise InputError(f"{path}: not TOML: {str(error).splitlines()[0]}") from error


def _beyond_64_bits(value: object, at: str = "") -> Iterator[str]:
    """Dotted paths of integers that TOML does not allow, but Python reads."""
    if isinstance(value, dict | list):
        parts = value.items() if isinstance(value, dict) else enumerate(value)
        for key, part in parts:
            yield from _beyond_64_bits(part, f"{at}.{key}" if at else str(key))
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        yield at


def checked(path: Path, content: Mapping[str, object], table: type[Table]) -> Table:
    """The content of a file as the model `table`; `path` is its name in messages.

    **Raises:** `InputError`, one line for each fault, with dotted paths; only one for a file of a different kind.
    """
    stated, field = content.get("schema"), table.model_fields.get("schema_")
    wanted = get_args(field.annotation) if field else ()
    # A different version of the same kind of file is validated, and all its faults are reported.
    same_kind = str(stated).rpartition("/")[0] in (str(schema).rpartition("/")[0] for schema in wanted)
    if str(stated).startswith("tumblecal.") and not same_kind:
        kind = f"not {wanted[0]!r}" if wanted else "but this kind of file has none"
        raise InputError(f"{path}: schema is {stated!r}, {kind}; check that this is the correct file")
    try:
        return table.model_validate(content)
    except ValidationError as error:
        raise InputError(validation_faults(path, error, table)) from error


def toml_string(text: str) -> str:
    """A text as a TOML basic string; that is a JSON string with escaped DEL and without halves of surrogates."""
    return encode_basestring(text.encode("utf-8", "replace").decode("utf-8")).replace("\x7f", "\\u007f")


def toml_table(name: str, values: Mapping[str, object]) -> list[str]:
    """The lines of a table, then a blank one; a name in brackets for a table of an array. Values of None are omitted."""
    return [f"[{name}]", *(f"{key} = {_toml(value)}" for key, value in values.items() if value is not None), ""]


def toml_lines(content: Mapping[str, object], above: str = "") -> list[str]:
    """The lines of a document: values first, then its tables, and arrays of tables, by their names after `above`. Values of
    None are omitted."""
    values = {name: value for name, value in content.items() if value is not None and not _has_tables(value)}
    lines = [f"{_key(name)} = {_toml(value)}" for name, value in values.items()]
    lines = [*([f"[{above}]"] if above and (lines or not content) else []), *lines, *([""] if lines else [])]
    for name, value in content.items():
        inner = f"{above}.{_key(name)}" if above else _key(name)
        if isinstance(value, Mapping):
            lines += toml_lines(value, inner)
        elif isinstance(value, list | tuple) and _has_tables(value):
            for table in value:
                lines += toml_table(f"[{inner}]", {_key(key): part for key, part in table.items()})
    return lines


def _has_tables(value: object) -> bool:
    """Whether a value is a table, or an array of tables."""
    return isinstance(value, Mapping) or (
        isinstance(value, list | tuple) and bool(value) and all(isinstance(part, Mapping) for part in value)
    )


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_string(name)


def _toml(value: object) -> str:
    """A text, number, list or inline table."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{_key(key)} = {_toml(part)}' for key, part in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return toml_string(value) if isinstance(value, str) else repr(value)
