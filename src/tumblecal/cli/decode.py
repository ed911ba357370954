"""`tumblecal decode`: samples of a log of bytes."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.capture.decoding.samples import Stated
from tumblecal.cli.output import Quiet, warn
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.capture.decoding.byte_file import FileContents


def decode(
    file: Path,
    /,
    *,
    protocol: str | None = None,
    out: Path | None = None,
    stated: Annotated[Stated, Parameter(name="*")] = Stated(),
    quiet: Quiet = False,
) -> None:
    """Decode a file of bytes received from a port (or the raw log of a capture), and describe its contents.

    Parameters
    ----------
    file
        File of bytes.
    protocol
        Name of the protocol. Default: guessed. Example: --protocol vectornav.
    out
        Table of samples to write (.csv or .parquet). Default: none. Example: --out samples.csv.
    """
    from rich.console import Console
    from rich.progress import Progress

    from tumblecal.capture.decoding.byte_file import decode_file
    from tumblecal.data.overwriting import protect_inputs

    protect_inputs([file], out=out)

    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(f"decoding {file.name}", total=file.stat().st_size if file.is_file() else None)
        contents = decode_file(
            file, protocol, out=out, stated=stated, progress=lambda size: bar.update(task, completed=size)
        )
    _describe(file, contents)
    refused = next((event.content["text"] for event in contents.events if event.kind == "refused"), None)
    if not contents.samples and refused is not None:
        raise InputError(f"{file}: {refused}")
    if out is not None and not contents.samples:
        raise InputError(f"{file}: no samples to write")
    if out is not None:
        print(f"{out}: {counted(contents.samples, 'sample')}")


def _describe(file: Path, contents: "FileContents") -> None:
    """Print the contents of a file."""
    counts = contents.counts
    print(f"{file}: {contents.protocol.title} (--protocol {contents.protocol.name})")
    print(
        f"{counts.frames} samples, {counts.special} other frames, {counts.check_failures} failed checks, "
        f"{counts.resyncs} resynchronisations, {counts.discarded} of {contents.size} bytes discarded"
    )
    for event in contents.events:
        shown = ", ".join(f"{k} {v}" for k, v in event.content.items() if k != "raw")
        if shown:
            print(f"{event.kind} at byte {event.stop}: {shown.encode('ascii', 'backslashreplace').decode()}")
    warn(file, contents.of_log)
    if contents.losses():
        print(contents.losses())
    if not contents.protocol.checked and counts.frames and not counts.check_failures:
        print("the lines may have no checksum: a lost character can then give a plausible, wrong number")
    if contents.samples:
        print(contents.statistics())
