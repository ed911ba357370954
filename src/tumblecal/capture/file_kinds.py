"""Plans of captures and files of virtual instruments: TOML without a schema, told apart by their tables."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tumblecal.ground.errors import InputError


@dataclass(frozen=True)
class FileKind:
    """What a file is, the command that takes it, and the keys that it alone may have."""

    what: str
    command: str
    keys: tuple[str, ...]


PLAN = FileKind("the plan of a capture", "capture", ("session", "port", "positions", "dwell", "limits"))
INSTRUMENT = FileKind(
    "the description of a virtual instrument",
    "emulate",
    ("instrument", "rig", "effects", "noise", "head", "faults", "mistake"),
)


def check_kind(path: Path, content: Mapping[str, object], wanted: FileKind) -> None:
    """Refuse a file of the other kind, `wanted` being one of `PLAN` and `INSTRUMENT`; one that has keys of both, or none, is
    left to its table.

    **Raises:** `InputError` naming what the file is and the command that takes it.
    """
    other = INSTRUMENT if wanted is PLAN else PLAN
    if (found := [key for key in other.keys if key in content]) and not any(key in content for key in wanted.keys):
        raise InputError(
            f"{path}: {other.what} (it has {', '.join(found)}), which tumblecal {other.command} takes; wanted here is "
            f"{wanted.what}, as tumblecal {wanted.command} takes it"
        )
