"""Results with functions in them, such as effects and links, as bytes for other processes."""

from dataclasses import fields as dataclass_fields
from typing import Any


class Pickled:
    """A dataclass that the standard pickle stores, whatever functions are in its fields (those of a script or lambdas, too)."""

    def __reduce__(self) -> tuple[Any, ...]:
        import cloudpickle

        fields = {field.name: getattr(self, field.name) for field in dataclass_fields(self)}  # type: ignore[arg-type]
        return _restored, (type(self), cloudpickle.dumps(fields))


def _restored(cls: type[Any], fields: bytes) -> Any:
    """An object of these fields, which were checked when it was made."""
    import cloudpickle

    restored = object.__new__(cls)
    vars(restored).update(cloudpickle.loads(fields))
    return restored
