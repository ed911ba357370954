"""Plans of captures and files of virtual instruments: TOML without a schema, recognised by their tables."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tumblecal.ground.errors import InputError


@dataclass(frozen=True)
class FileKind:
    """A kind of file: its name in words, its command, and the keys that no other kind has."""

    what: str
    command: str
    keys: tuple[str, ...]


PLAN = FileKind("the plan of a capture", "capture", ("session", "port", "positions", "dwell", "limits", "conditions"))
INSTRUMENT = FileKind(
    "the description of a virtual instrument",
    "emulate",
    ("instrument", "rig", "effects", "noise", "head", "faults", "mistake"),
)


def check_kind(path: Path, content: Mapping[str, object], wanted: FileKind) -> None:
    """Raise for a file of the other kind; `wanted` is `PLAN` or `INSTRUMENT`. Files with keys of both, or of none, pass.

    **Raises:** `InputError` with the kind of the file and its command.
    """
    other = INSTRUMENT if wanted is PLAN else PLAN
    if (found := [key for key in other.keys if key in content]) and not any(key in content for key in wanted.keys):
        raise InputError(
            f"{path}: {other.what} for tumblecal {other.command} (it has {', '.join(found)}); tumblecal {wanted.command} needs "
            f"{wanted.what}"
        )
