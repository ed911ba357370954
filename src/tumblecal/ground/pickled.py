"""Results that hold functions, such as effects and links, as bytes for other processes."""

from typing import Any


class Pickled:
    """A dataclass that the standard pickle stores, whatever functions its fields hold (those of a script or lambdas, too)."""

    def __reduce__(self) -> tuple[Any, ...]:
        import cloudpickle

        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}  # type: ignore[attr-defined]
        return _restored, (type(self), cloudpickle.dumps(fields))


def _restored(cls: type[Any], fields: bytes) -> Any:
    """An object of these fields, which were checked when it was made."""
    import cloudpickle

    restored = object.__new__(cls)
    vars(restored).update(cloudpickle.loads(fields))
    return restored
