"""JSON files of this program as pydantic models: the first fault of each list of numbers, with its dotted path."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainSerializer,
    TypeAdapter,
    ValidationError,
)
from pydantic_core import CoreSchema, core_schema

from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import read_json
from tumblecal.ground.text_file import shown
from tumblecal.ground.toml_faults import json_faults


class Record(BaseModel):
    """An object of a JSON file: no silent conversions; unknown keys of later versions are kept."""

    model_config: ClassVar[ConfigDict] = ConfigDict(strict=True, extra="allow", frozen=True)


# Larger numbers are not those of a sensor, and would overflow.
LARGEST = 1e12
# Relative rounding of a covariance.
_ROUNDING = 1e-9
Finite = Annotated[float, Field(strict=True, ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Size = Annotated[Finite, Field(ge=0)]
Flag = Annotated[bool, Field(strict=True)]
Text = Annotated[str, Field(strict=True)]


def one_of(names: Sequence[str]) -> AfterValidator:
    """A text that is one of these."""

    def listed(name: str) -> str:
        if name not in names:
            raise ValueError(f"must be one of {', '.join(names)}")
        return name

    return AfterValidator(listed)


Model = TypeVar("Model", bound=Record)


@dataclass(frozen=True)
class Shape:
    """Annotation of an array: nested lists of finite numbers; a size of None is any size."""

    sizes: tuple[int | None, ...]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        schema = handler.generate_schema(Finite)
        for size in reversed(self.sizes):
            schema = core_schema.list_schema(schema, min_length=size, max_length=size)
        return core_schema.no_info_after_validator_function(np.array, schema)


def require_covariance(table: np.ndarray) -> np.ndarray:
    """An array that can be a covariance.

    **Raises:** `ValueError`.
    """
    largest = float(np.max(np.abs(table), initial=0.0))
    if table.shape != table.shape[::-1] or np.max(np.abs(table - table.T), initial=0.0) > _ROUNDING * largest:
        raise ValueError("a covariance must be symmetric; use the file as the program wrote it")
    if np.any(np.diag(table) < 0) or np.min(np.linalg.eigvalsh(table), initial=0.0) < -_ROUNDING * largest:
        raise ValueError("no variance of a covariance may be negative; use the file as the program wrote it")
    return table


LISTED = PlainSerializer(np.ndarray.tolist)
Covariance = Annotated[np.ndarray, Shape((None, None)), AfterValidator(require_covariance), LISTED]


@dataclass(frozen=True)
class AsStated:
    """Annotation of a value that is read and written as stated, if it agrees with a model."""

    model: Any

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_wrap_validator_function(
            lambda stated, validate: (validate(stated), stated)[1],
            handler.generate_schema(self.model),
            serialization=core_schema.plain_serializer_function_ser_schema(lambda stated: stated),
        )


def read_record(path: Path, model: type[Model], remedy: str) -> Model:
    """A JSON file as its model, which has a field `schema_`.

    **Raises:** `InputError`: one line for a file of another kind, with the remedy; otherwise one for each fault.
    """
    content = read_json(path)
    (schema,) = get_args(model.model_fields["schema_"].annotation)
    stated = content.get("schema") if isinstance(content, dict) else None
    if stated != schema:
        raise InputError(f"{path}: schema is {shown(stated)}, not {schema!r}; {remedy}")
    return validated(content, model, str(path))


# Building the adapter of a kind takes milliseconds.
_adapter = lru_cache(TypeAdapter)


def validated(content: object, kind: Any, named: str, within: str = "") -> Any:
    """The content of a part of a file as a model or any other annotation.

    **Arguments:**

    - `named`: the file, for faults. `within`: the dotted path of the part.

    **Raises:** `InputError`, one line for each fault.
    """
    try:
        return _adapter(kind).validate_python(content)
    except ValidationError as error:
        raise InputError(json_faults(named, error, within)) from error
