"""The origin of data in the provenance of a result: files with their SHA-256, number of positions, version of the program."""

import hashlib
from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator

from tumblecal import __version__
from tumblecal.ground.record import LEFT_OUT, Count, ResultRecord, at


def digest_of(file: str) -> str | None:
    """SHA-256 of the content of a file; None for a folder, or for data that are not from a file."""
    path = Path(file)
    if not path.is_file():
        return None
    with path.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


Digest = Annotated[str | None, BeforeValidator(digest_of)]


class SourceRecord(ResultRecord):
    """The source of a `PositionSet`; for several files, the SHA-256 of each."""

    data: str = at("source")
    sha256: Digest = at("source")
    positions: Count = at("result")
    tumblecal: str = __version__
    files: Annotated[
        dict[str, Digest],
        BeforeValidator(lambda files: {file: file for file in files} if len(files) > 1 else {}),
        LEFT_OUT,
    ]
    measured_utc: Annotated[str | None, BeforeValidator(lambda stated: stated.get("measured_utc")), LEFT_OUT] = at(
        "comments"
    )
