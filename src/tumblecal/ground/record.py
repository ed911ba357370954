"""Records of results: typed objects that read the attributes of a result, and that JSON files contain.

class TestRecord(ResultRecord):
    p_value: float
    level: float = 0.005
    words: str = at("noise.words")
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from pydantic import AliasGenerator, AliasPath, BaseModel, BeforeValidator, ConfigDict, Field, model_validator
from pydantic_core import PydanticUndefined

from tumblecal.ground.atomic import write_text
from tumblecal.ground.json_file import json_text


class ResultRecord(BaseModel):
    """A record of a result: each field is the attribute of the result with this name, or at the path of `at`.

    A key that is reserved in Python or pydantic ends with `_` in the class, as `schema_`. Numbers that are not finite are null
    in JSON.
    """

    model_config: ClassVar[ConfigDict] = ConfigDict(
        frozen=True,
        from_attributes=True,
        extra="forbid",
        defer_build=True,
        alias_generator=AliasGenerator(serialization_alias=lambda name: name.removesuffix("_")),
    )

    @model_validator(mode="before")
    @classmethod
    def _with_itself(cls, value: object) -> object:
        """The attribute `result` of a result is itself."""
        return value if isinstance(value, Mapping | BaseModel | _Extended) else _Extended(value, {})

    @classmethod
    def of(cls, result: object, **more: object) -> Self:
        """The record of a result.

        **Arguments:**

        - `more`: further attributes, or others in place of those of the result.
        """
        return cls.model_validate(_Extended(result, more))

    def write(self, path: Path) -> None:
        """Write the record as a JSON file."""
        write_text(path, json_text(self))

    def plain(self) -> dict[str, Any]:
        """The record as plain numbers, lists and texts, for a part of another file."""
        return self.model_dump(mode="json", by_alias=True)


@dataclass(frozen=True)
class _Extended:
    """A result with further attributes."""

    result: object
    more: Mapping[str, object]

    def __getattr__(self, name: str) -> object:
        return self.more[name] if name in self.more else getattr(self.result, name)


class Quantity(ResultRecord):
    """A value in `unit`."""

    value: float
    unit: str


class Estimate(Quantity):
    """A value with its standard uncertainty `sd`."""

    sd: float | None


class FileRecord(ResultRecord):
    """A file and its SHA-256; null for a folder."""

    file: str
    sha256: str | None


def at(path: str, default: object = PydanticUndefined) -> Any:
    """A field that is not the attribute with its name: a path of attributes and of numbers in sequences, such as `noise.sd.0`;
    `result` is the result itself.

    **Arguments:**

    - `default`: if a part of the path does not exist, or is None.
    """
    parts = [int(part) if part.isdigit() else part for part in path.split(".")]
    return Field(default, validation_alias=AliasPath(*parts))  # type: ignore[arg-type]


# A field that is not a key without a value.
LEFT_OUT = Field(exclude_if=lambda value: value in (None, (), [], {}))


# Null for an empty value.
OR_NULL = BeforeValidator(lambda value: value or None)
TextOrNull = Annotated[str | None, OR_NULL]


# The number of items of an attribute.
Count = Annotated[int, BeforeValidator(len)]


def by_name(names: Sequence[str]) -> BeforeValidator:
    """An array with a value for each of some names, as values by name."""
    return BeforeValidator(lambda values: dict(zip(names, values, strict=True)))


def estimates(fit: Any, **more: Iterable) -> dict[str, dict[str, Any]]:
    """Values, standard uncertainties and units of a fit, or of something else with these attributes, by `names`; none of
    None. `more`: further columns."""
    return {} if fit is None else table(fit.names, value=fit.values, sd=fit.sd, unit=fit.units, **more)


def rows(**columns: Iterable) -> list[dict[str, Any]]:
    """The rows of a table, given by its columns."""
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def table(names: Iterable[str], **columns: Iterable) -> dict[str, dict[str, Any]]:
    """The rows of a table by name."""
    return dict(zip(names, rows(**columns), strict=True))


Estimates = Annotated[dict[str, Estimate], BeforeValidator(estimates)]
