"""`tumblecal decode`: samples of a log of bytes."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tumblecal.capture.decoding.samples import Stated
from tumblecal.cli.command import Command
from tumblecal.cli.options import Quiet
from tumblecal.cli.result_files import table_file
from tumblecal.cli.terminal import warn
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted


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
    from tumblecal.capture.decoding.byte_file import decode_file

    if out is not None:
        table_file(out, [file])
    with Command(quiet).working(f"decoding {file}"):
        contents = decode_file(file, protocol, out=out, stated=stated)
    counts, read = contents.counts, contents.protocol
    print(f"{file}: {read.title} (--protocol {read.name})")
    print(
        f"{counts.frames} samples, {counts.special} other frames, {counts.check_failures} failed checks, "
        f"{counts.resyncs} resynchronisations, {counts.discarded} of {contents.bytes} bytes discarded"
    )
    for event in contents.events:
        if shown := ", ".join(f"{key} {value}" for key, value in event.content.items() if key != "raw"):
            print(f"{event.kind} at byte {event.stop}: {shown.encode('ascii', 'backslashreplace').decode()}")
    warn(file, contents.of_log)
    unchecked = not read.checked and counts.frames and not counts.check_failures
    checks = "the lines may have no checksum: a lost character can then give a plausible, wrong number"
    statistics = contents.statistics() if contents.samples else ""
    for words in filter(None, (contents.losses(), checks * bool(unchecked), statistics)):
        print(words)
    if not contents.samples:
        refused = [event.content["text"] for event in contents.events if event.kind == "refused"]
        if refused or out is not None:
            raise InputError(f"{file}: {refused[0] if refused else 'no samples to write'}")
    if out is not None:
        print(f"{out}: {counted(contents.samples, 'sample')}")
