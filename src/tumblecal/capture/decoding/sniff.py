"""Recognition of the protocol of bytes: all are tried, and the one that explains most is used."""

import re
from pathlib import Path
from typing import NamedTuple

from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.protocols import protocols
from tumblecal.ground.errors import InputError


ENOUGH = 0.95
# Number of bytes that are examined.
_LOOKED_AT = 1 << 16


class Guess(NamedTuple):
    """Match of a protocol to bytes: fraction of bytes in complete frames, frames with samples and without."""

    name: str
    explained: float
    frames: int
    special: int
    check_failures: int


def guesses(data: bytes) -> list[Guess]:
    """All protocols, the best first.

    **Arguments:**

    - `data`: bytes from anywhere in a stream; at least 2 kB are useful.
    """
    found = list[Guess]()
    for name, how in protocols().items():
        counts = decode_all(how.decoder(), data).counts
        # An unfinished frame at either end is no evidence against a protocol.
        wrong = max(0, counts.discarded - min(128, len(data) // 4))
        explained = 1 - wrong / max(len(data), 1) if counts.frames + counts.special else 0.0
        found.append(Guess(name, explained, counts.frames, counts.special, counts.check_failures))
    # Lines of a protocol with checksums are also lines of numbers: then the stricter protocol is preferred.
    return sorted(found, key=lambda g: (round(g.explained, 2), protocols()[g.name].checked, g.frames), reverse=True)


def guessed(path: Path, data: bytes) -> str:
    """The protocol of the beginning of a file.

    **Raises:** `InputError` if none fits.
    """
    best, *_ = ranked = guesses(data[:_LOOKED_AT])
    if best.explained < ENOUGH:
        seen = ", ".join(f"{g.name} {g.explained:.0%}" for g in ranked if g.explained > 0.01) or "nothing"
        raise InputError(
            f"{path}: no protocol fits these bytes (recognised: {seen}); to read them anyway, give --protocol"
        )
    return best.name


def described(data: bytes, wanted: str) -> str:
    """One line for the operator on bytes that the expected protocol cannot read."""
    best = guesses(data)[0]
    if best.explained >= ENOUGH and best.name == wanted:
        events = decode_all(protocols()[wanted].decoder(), data).events
        refused = (event.content["text"] for event in events if event.kind == "refused")
        return next(refused, f"the device sends {wanted} without a specific force: enable it in the device")
    if best.explained >= ENOUGH:
        return f'the device sends {best.name}, not {wanted}; set port.protocol = "{best.name}" in the plan'
    share = f"{best.explained:.0%} of the bytes are correct {best.name} frames" if best.explained > 0.3 else ""
    return f"{share or unknown_words(data)}: a different device, a bad cable, or a wrong baud rate (`tumblecal sniff PORT`)"


def unknown_words(data: bytes) -> str:
    """Description of bytes that no protocol and no format fits."""
    data = data[:_LOOKED_AT]
    if len(re.findall(rb"[\x09\x0a\x0d\x20-\x7e]", data)) > 0.95 * len(data):
        lines = data.split(b"\n")
        return f"text without three numbers a line, e.g. {lines[len(lines) // 2][:60].decode('ascii', 'replace').strip()!r}"
    return f"{len(data)} bytes of another format or of compressed data, or a wrong baud rate"
