"""`tumblecal sniff`: protocol and baud rate of a device."""

import time
from pathlib import Path

from tumblecal.cli.options import Positive
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import suggested


# The most frequent rates are tried first.
_FIRST = (115200, 921600)


def sniff(port: str, /, *, baud: list[int] | None = None, seconds: Positive = 2.0) -> None:
    """Identify the protocol of a serial port at the usual baud rates, or of a file of bytes.

    Nothing is sent to the device. To read such a file: tumblecal decode FILE.

    Parameters
    ----------
    port
        Serial port (listed by tumblecal ports), or a file of bytes.
    baud
        Baud rate to try. Repeatable. Default: the usual rates. Example: --baud 460800.
    seconds
        Listening time at each rate, s. Example: --seconds 5.
    """
    from tumblecal.capture.decoding.sniff import ENOUGH, guesses
    from tumblecal.capture.protocols import protocols
    from tumblecal.show.tables import Table

    known = protocols()
    if Path(port).is_file():
        _sniff_file(Path(port))
        return
    rows, found = list[tuple[str, ...]](), ""
    usual = {rate for protocol in known.values() for rate in protocol.bauds}
    for rate in baud or [*_FIRST, *sorted(usual - {*_FIRST})]:
        if not (data := _listen(port, rate, seconds)):
            continue
        best = guesses(data)[0]
        numbers = (f"{best.explained:.0%}", f"{best.frames / seconds:.0f}", str(best.check_failures))
        rows.append((str(rate), f"{len(data) / seconds:.0f}", best.name if best.explained else "none", *numbers))
        if best.explained >= ENOUGH and best.frames + best.special >= 3:
            found = f'{known[best.name].title}; in the plan: protocol = "{best.name}", baud = {rate}'
            break
    if not rows:
        raise InputError(
            f"port {port}: no bytes at any baud rate; check power and cable, and whether the device waits for a command"
        )
    print(Table(("baud", "bytes/s", "protocol", "explained", "samples/s", "bad checks"), rows))
    if not found:
        raise InputError(f"port {port}: unknown protocol; save some of the bytes and run: tumblecal decode FILE")
    print(f"port {port}: {found}")


def _listen(url: str, rate: int, seconds: float) -> bytes:
    """The bytes that arrive in a time."""
    from tumblecal.capture.port.transport import Port

    port, data, stop = Port(url, rate), b"", time.monotonic() + seconds
    try:
        while time.monotonic() < stop:
            data += port.read()
            time.sleep(0.01)
    finally:
        port.close()
    return data


def _sniff_file(path: Path) -> None:
    """Print the protocols that fit the beginning of a file, or its format.

    **Raises:** `InputError` if none fits.
    """
    from tumblecal.capture.decoding.byte_file import pieces_of
    from tumblecal.capture.decoding.sniff import guesses, unknown_words
    from tumblecal.capture.protocols import protocols
    from tumblecal.recordings.formats import reader_of

    data = next(pieces_of(path), b"")
    fitting = [guess for guess in guesses(data) if guess.frames + guess.special]
    for guess in fitting:
        title = protocols()[guess.name].title
        print(f"{guess.name}: {guess.explained:.0%} of the bytes, {guess.frames} samples ({title})")
    if fitting:
        return
    reader = reader_of(path) if data else None
    if reader is None or reader.title == "text":
        words = unknown_words(data) if data else "the file is empty"
        raise InputError(f"{path}: unknown protocol in the first megabyte: {words}")
    print(f"{path}: {reader.title}; to describe its contents, run: {suggested('import', path)}")
