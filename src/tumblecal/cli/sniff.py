"""`tumblecal sniff`: protocol and baud rate of a device."""

from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import suggested


def sniff(port: str, /, *, baud: list[int] | None = None, seconds: float = 2.0) -> None:
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
    import time
    from pathlib import Path

    from rich import box
    from rich.console import Console
    from rich.table import Table

    from tumblecal.capture.decoding.sniff import ENOUGH, guesses
    from tumblecal.capture.port.transport import Port
    from tumblecal.capture.protocols import protocols

    if Path(port).is_file():
        _sniff_file(Path(port))
        return
    usual = sorted(
        {rate for p in protocols().values() for rate in p.bauds}, key=lambda r: (r != 115200, r != 921600, r)
    )
    table = Table(box=box.SIMPLE)
    for name in ("baud", "bytes/s", "protocol", "explained", "samples/s", "bad checks"):
        table.add_column(name, justify="right")
    verdict, total = None, 0
    for rate in baud or usual:
        data = _listen(Port(port, rate), seconds, time)
        total += len(data)
        if not data:
            continue
        best = guesses(data)[0]
        table.add_row(
            str(rate),
            f"{len(data) / seconds:.0f}",
            best.name if best.explained else "none",
            f"{best.explained:.0%}",
            f"{best.frames / seconds:.0f}",
            str(best.check_failures),
        )
        if best.explained >= ENOUGH and best.frames + best.special >= 3:
            verdict = (best.name, rate)
            break
    if not total:
        raise InputError(
            f"port {port}: no bytes at any baud rate; check power and cable, and whether the device waits for a command"
        )
    Console().print(table)
    if verdict is None:
        raise InputError(f"port {port}: unknown protocol; save some of the bytes and run: tumblecal decode FILE")
    print(f'port {port}: {protocols()[verdict[0]].title}; in the plan: protocol = "{verdict[0]}", baud = {verdict[1]}')


def _listen(port, seconds: float, time) -> bytes:
    data, stop = b"", time.monotonic() + seconds
    try:
        while time.monotonic() < stop:
            data += port.read()
            time.sleep(0.01)
    finally:
        port.close()
    return data


def _sniff_file(path) -> None:
    from tumblecal.capture.decoding.byte_file import pieces_of
    from tumblecal.capture.decoding.sniff import guesses, unknown_words
    from tumblecal.capture.protocols import protocols
    from tumblecal.recordings.formats import reader_of

    data = next(pieces_of(path), b"")
    fitting = [g for g in guesses(data) if g.frames + g.special]
    reader = reader_of(path) if data and not fitting else None
    if reader is not None and reader.title != "text":
        print(f"{path}: {reader.title}; to describe its contents, run: {suggested('import', path)}")
        return
    if not fitting:
        words = unknown_words(data) if data else "the file is empty"
        raise InputError(f"{path}: unknown protocol in the first megabyte: {words}")
    for guess in fitting:
        title = protocols()[guess.name].title
        print(f"{guess.name}: {guess.explained:.0%} of the bytes, {guess.frames} samples ({title})")
